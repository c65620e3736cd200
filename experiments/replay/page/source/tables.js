/** What the pictures show, as tables that follow the cursor, and as sentences. */

import { flightMark } from "./curves.js";
import { byId, make, setText } from "./dom.js";
import { droneRows, metricAt, metricMean, momentOf, serviceOf } from "./replay.js";
import { clockText, countText, numberText, rateText } from "./text.js";

const DRONE_HEADS = ["Drone", "East (m)", "North (m)", "Altitude (m)", "Speed (m/s)", "Transmit power (W)", "People served", "Slowest of them"];
const SPOKEN_METRICS = 3;

/**
 * The table of each flight's drones.
 *
 * @param {object} replay
 * @returns {(slot: number) => void} shows a slot
 */
export function buildDroneTables(replay) {
  const shows = replay.flights.map((flight, index) => {
    const rows = flight.drones.names.map((name) => {
      const cells = DRONE_HEADS.slice(1).map(() => make("td"));
      return { cells, row: make("tr", {}, make("th", { scope: "row" }, make("bdi", {}, name)), ...cells) };
    });
    const caption = make("caption", {}, flightMark(index), make("bdi", {}, flight.label));
    byId("drone-tables").append(scrollable(`Drones of ${flight.label}`, caption, DRONE_HEADS, rows.map(({ row }) => row)));
    return (slot) => {
      const told = droneRows(momentOf(replay, flight, slot), replay, flight);
      told.forEach((drone, place) => {
        const texts = [
          numberText(drone.eastM, 1),
          numberText(drone.northM, 1),
          numberText(drone.upM, 1),
          numberText(drone.speedMps, 1),
          drone.powerW > 0 ? numberText(drone.powerW, 3) : "out of service",
          String(drone.people),
          rateText(drone.slowestBps),
        ];
        texts.forEach((text, column) => setText(rows[place].cells[column], text));
      });
    };
  });
  return (slot) => shows.forEach((show) => show(slot));
}

/**
 * The table of all metrics of each flight.
 *
 * @param {object} replay
 * @returns {(slot: number) => void} shows a slot
 */
export function buildSummary(replay) {
  const { flights, metrics } = replay;
  const slotCells = [];
  const rows = metrics.map((metric) => {
    const cells = flights.flatMap((flight) => {
      const now = make("td");
      slotCells.push({ cell: now, flight, metric });
      return [now, make("td", {}, numberText(metricMean(flight, metric.key), metric.digits))];
    });
    const unit = metric.unit && ` (${metric.unit})`;
    return make("tr", {}, make("th", { scope: "row" }, make("bdi", {}, metric.label), unit), ...cells);
  });
  const heads = flights.flatMap((flight) => [`${flight.label}: this slot`, `${flight.label}: mean of all slots`]);
  const caption = make("caption", {}, "Metrics");
  byId("summary-table").append(scrollable("Metrics", caption, ["Metric", ...heads], rows));
  return (slot) => {
    for (const { cell, flight, metric } of slotCells) {
      setText(cell, numberText(metricAt(flight, metric.key, slot), metric.digits));
    }
  };
}

/**
 * Who is served in a slot, in a sentence.
 *
 * @param {import("./replay.js").Moment} moment
 * @param {object} replay
 * @returns {string}
 */
export function serviceText(moment, replay) {
  const service = serviceOf(moment, replay);
  const masts = replay.masts.length || service.byMasts ? `, ${service.byMasts} by masts` : "";
  const rates = Number.isFinite(service.slowestBps)
    ? ` Rates of those served: slowest ${rateText(service.slowestBps)}, median ${rateText(service.medianBps)}.`
    : "";
  const by = `${countText(service.byDrones, "person", "people")} served by drones`;
  return `${by}${masts}, ${service.unserved} not served.${rates}`;
}

/**
 * A slot in a few sentences, for those who hear the page.
 *
 * @param {object} replay
 * @param {number} slot
 * @returns {string}
 */
export function slotSentences(replay, slot) {
  const flights = replay.flights.map((flight) => {
    const values = replay.metrics
      .slice(0, SPOKEN_METRICS)
      .map((metric) => `${metric.label} ${numberText(metricAt(flight, metric.key, slot), metric.digits)} ${metric.unit}`.trim());
    const people = serviceText(momentOf(replay, flight, slot), replay);
    return `${flight.label}: ${slot ? `${values.join(", ")}. ` : ""}${people}`;
  });
  return `${slotText(replay, slot)}. ${flights.join(" ")}`;
}

/**
 * @param {object} replay
 * @param {number} slot
 * @returns {string} such as Slot 120 of 600, 2:00
 */
export function slotText(replay, slot) {
  return `Slot ${slot} of ${replay.slots}, ${clockText(slot * replay.slotS)}`;
}

function scrollable(name, caption, heads, rows) {
  const head = make("tr", {}, ...heads.map((text) => make("th", { scope: "col" }, make("bdi", {}, text))));
  const table = make("table", {}, caption, make("thead", {}, head), make("tbody", {}, ...rows));
  return make("div", { class: "wide", role: "region", "aria-label": name, tabindex: 0 }, table);
}
