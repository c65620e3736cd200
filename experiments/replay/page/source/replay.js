/** A replay as the page uses it: unpacked arrays, and what can be said of a moment. */

import { startOf, unpack } from "./decode.js";
import { plain } from "./text.js";

export const UNSERVED = -1;
const SCHEMA = 1;
const LONGEST_TITLE = 300;

/**
 * Unpack a document.
 *
 * @param {object} source the parsed JSON; `experiments/replay/document.py` describes it
 * @returns {Promise<object>} the same with names that can be shown and `States` for arrays
 */
export async function openReplay(source) {
  if (source.schema !== SCHEMA) {
    throw new Error(`This page reads schema ${SCHEMA}, and the flight has schema ${plain(source.schema)}.`);
  }
  const [targets, positions] = await Promise.all([
    unpack(source.users.targets),
    unpack(source.users.positions),
  ]);
  return {
    title: plain(source.title, LONGEST_TITLE),
    subtitle: plain(source.subtitle, LONGEST_TITLE),
    slotS: source.slot_s,
    slots: source.slots,
    areaM: source.area_m,
    place: source.place,
    people: {
      count: source.users.count,
      names: source.users.names?.map((name) => plain(name)) ?? null,
      weights: source.users.weights,
      targets: targets.values,
      positions,
    },
    masts: source.masts.map((mast) => ({ name: plain(mast.name), positionM: mast.position_m })),
    metrics: source.metrics.map((metric) => ({
      ...metric,
      label: capital(plain(metric.label)),
      unit: plain(metric.unit),
    })),
    flights: await Promise.all(source.flights.map(openFlight)),
  };
}

async function openFlight(source) {
  const { drones } = source;
  const [positions, powersW, association, rates, centres] = await Promise.all([
    unpack(drones.positions),
    unpack(drones.powers_w),
    unpack(source.association),
    unpack(source.rates),
    drones.stations ? unpack(drones.stations.centres) : null,
  ]);
  const metrics = new Map();
  for (const [key, packed] of Object.entries(source.metrics)) {
    metrics.set(key, (await unpack(packed)).values);
  }
  return {
    label: plain(source.label),
    note: plain(source.note, LONGEST_TITLE),
    association,
    rates,
    metrics,
    drones: { count: drones.count, names: drones.names.map((name) => plain(name)), positions, powersW },
    stations: centres && { centres, radiusM: drones.stations.radius_m },
  };
}

/**
 * A metric in a slot; NaN where there is none, as before the first slot.
 *
 * @param {object} flight
 * @param {string} key
 * @param {number} slot
 * @returns {number}
 */
export function metricAt(flight, key, slot) {
  return flight.metrics.get(key)?.[slot - 1] ?? NaN;
}

/**
 * The mean of a metric over all slots that have it.
 *
 * @param {object} flight
 * @param {string} key
 * @returns {number}
 */
export function metricMean(flight, key) {
  const values = (flight.metrics.get(key) ?? new Float64Array()).filter(Number.isFinite);
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

/**
 * Where everybody is at a time between two slots, and who serves whom in the slot before it.
 *
 * @typedef {object} Moment
 * @property {number} slot
 * @property {Float64Array} people east and north of each
 * @property {Float64Array} drones east, north and up of each
 * @property {Float64Array|null} stations east and north of each
 * @property {Float64Array} servers who serves each person, as in the document
 * @property {Float64Array} rates of each person, bit/s
 * @property {Float64Array} powersW of each drone; 0 out of service
 */

/**
 * @param {object} replay
 * @param {object} flight one of its flights
 * @param {number} time in slots
 * @returns {Moment}
 */
export function momentOf(replay, flight, time) {
  const slot = Math.floor(time);
  return {
    slot,
    people: between(replay.people.positions, time),
    drones: between(flight.drones.positions, time),
    stations: flight.stations && between(flight.stations.centres, time),
    servers: stateOf(flight.association, slot),
    rates: stateOf(flight.rates, slot),
    powersW: stateOf(flight.drones.powersW, slot),
  };
}

/**
 * What a table says of each drone.
 *
 * @param {Moment} moment of a whole slot
 * @param {object} replay
 * @param {object} flight
 * @returns {Array<{eastM: number, northM: number, upM: number, speedMps: number, powerW: number, people: number, slowestBps: number}>}
 */
export function droneRows(moment, replay, flight) {
  const before = stateOf(flight.drones.positions, Math.max(moment.slot - 1, 0));
  const rows = Array.from({ length: flight.drones.count }, (_, index) => {
    const [eastM, northM, upM] = moment.drones.subarray(3 * index, 3 * index + 3);
    const wayM = Math.hypot(eastM - before[3 * index], northM - before[3 * index + 1]);
    const speedMps = moment.slot ? wayM / replay.slotS : NaN;
    const powerW = moment.powersW[index];
    return { eastM, northM, upM, speedMps, powerW, people: 0, slowestBps: NaN };
  });
  for (let person = 0; person < replay.people.count; person += 1) {
    const row = rows[moment.servers[person]];
    if (row) {
      row.people += weightOf(replay, person);
      row.slowestBps = Math.min(moment.rates[person], row.slowestBps || Infinity);
    }
  }
  return rows;
}

/**
 * How many are served by whom, and how fast.
 *
 * @param {Moment} moment
 * @param {object} replay
 * @returns {{byDrones: number, byMasts: number, unserved: number, slowestBps: number, medianBps: number}}
 */
export function serviceOf(moment, replay) {
  const service = { byDrones: 0, byMasts: 0, unserved: 0, slowestBps: NaN, medianBps: NaN };
  const served = [];
  for (let person = 0; person < replay.people.count; person += 1) {
    const server = moment.servers[person];
    const weight = weightOf(replay, person);
    if (server === UNSERVED) {
      service.unserved += weight;
    } else {
      service[server >= 0 ? "byDrones" : "byMasts"] += weight;
      served.push({ rate: moment.rates[person], weight });
    }
  }
  if (served.length) {
    served.sort((one, other) => one.rate - other.rate);
    const total = served.reduce((sum, { weight }) => sum + weight, 0);
    let passed = 0;
    service.slowestBps = served[0].rate;
    service.medianBps = served.find(({ weight }) => (passed += weight) >= total / 2).rate;
  }
  return service;
}

/**
 * Who serves somebody, in words.
 *
 * @param {object} replay
 * @param {object} flight
 * @param {number} server as in the document
 * @returns {string}
 */
export function serverName(replay, flight, server) {
  if (server >= 0) return flight.drones.names[server] ?? `drone ${server}`;
  return server === UNSERVED ? "nobody" : replay.masts[-2 - server]?.name ?? "a mast";
}

/**
 * The mast's place in `masts`, or -1 where it is none that serves.
 *
 * @param {number} server as in the document
 * @returns {number}
 */
export function mastOf(server) {
  return server < UNSERVED ? -2 - server : -1;
}

/**
 * The corners of a rectangle that holds the area and everything that ever happens.
 *
 * @param {object} replay
 * @returns {{west: number, south: number, east: number, north: number}}
 */
export function boundsOf(replay) {
  const bounds = { west: 0, south: 0, east: replay.areaM[0], north: replay.areaM[1] };
  const include = (values, stride) => {
    for (let place = 0; place + 1 < values.length; place += stride) {
      bounds.west = Math.min(bounds.west, values[place]);
      bounds.east = Math.max(bounds.east, values[place]);
      bounds.south = Math.min(bounds.south, values[place + 1]);
      bounds.north = Math.max(bounds.north, values[place + 1]);
    }
  };
  include(replay.people.positions.values, 2);
  for (const mast of replay.masts) include(mast.positionM, 3);
  for (const flight of replay.flights) include(flight.drones.positions.values, 3);
  return bounds;
}

function capital(text) {
  return text.slice(0, 1).toUpperCase() + text.slice(1);
}

function weightOf(replay, person) {
  return replay.people.weights?.[person] ?? 1;
}

function stateOf(states, slot) {
  const start = startOf(states, slot);
  return states.values.subarray(start, start + states.size);
}

function between(states, time) {
  const slot = Math.floor(time);
  const share = time - slot;
  const now = stateOf(states, slot);
  if (share === 0) return now;
  const next = stateOf(states, slot + 1);
  return now.map((value, place) => value + share * (next[place] - value));
}
