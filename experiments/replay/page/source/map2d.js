/** A flight from above, on a canvas. It needs nothing that a browser may lack. */

import { droneColour, niceStep, personLook, serverColour, SHAPES } from "./look.js";
import { boundsOf, mastOf, UNSERVED } from "./replay.js";
import { lengthText, numberText } from "./text.js";

const MARGIN = 26;
const FONT = "600 12px system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";
const REACH = 12;

/** Draws moments of one flight. */
export class Map2d {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {object} replay
   * @param {object} flight
   */
  constructor(canvas, replay, flight) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.replay = replay;
    this.flight = flight;
    this.bounds = boundsOf(replay);
    this.moment = null;
  }

  /** Take the size of the page's box. */
  resize(width, height, pixelRatio) {
    this.canvas.width = Math.round(width * pixelRatio);
    this.canvas.height = Math.round(height * pixelRatio);
    const { west, south, east, north } = this.bounds;
    this.scale = Math.min((width - 2 * MARGIN) / (east - west), (height - 2 * MARGIN) / (north - south));
    this.left = (width - this.scale * (east - west)) / 2;
    this.bottom = (height + this.scale * (north - south)) / 2;
    this.size = { width, height, pixelRatio };
  }

  /**
   * @param {import("./replay.js").Moment} moment
   * @param {object} state what is shown, see `views.js`
   */
  draw(moment, state) {
    if (!this.size?.width) return;
    this.moment = moment;
    const { pen, size } = this;
    pen.setTransform(size.pixelRatio, 0, 0, size.pixelRatio, 0, 0);
    pen.clearRect(0, 0, size.width, size.height);
    pen.font = FONT;
    this.drawGround(state.look);
    if (state.links) this.drawLinks(moment, state);
    if (moment.stations) this.drawStations(moment, state);
    if (state.trails) this.drawTrails(moment, state);
    this.drawPeople(moment, state);
    this.drawMasts(state.look);
    this.drawDrones(moment, state);
    this.drawScale(state.look);
  }

  /**
   * What lies at a place of the picture.
   *
   * @returns {{kind: "drone"|"person", index: number}|null}
   */
  pick(x, y) {
    if (!this.moment) return null;
    const { drones, people } = this.moment;
    return this.nearest("drone", drones, 3, x, y) ?? this.nearest("person", people, 2, x, y);
  }

  nearest(kind, places, stride, x, y) {
    let best = null;
    let least = REACH;
    for (let index = 0; index * stride < places.length; index += 1) {
      const [left, top] = this.at(places[stride * index], places[stride * index + 1]);
      const distance = Math.hypot(left - x, top - y);
      if (distance < least) {
        least = distance;
        best = { kind, index };
      }
    }
    return best;
  }

  at(eastM, northM) {
    const { west, south } = this.bounds;
    return [this.left + this.scale * (eastM - west), this.bottom - this.scale * (northM - south)];
  }

  drawGround(look) {
    const { pen } = this;
    const [east, north] = this.replay.areaM;
    const [left, top] = this.at(0, north);
    const [right, bottom] = this.at(east, 0);
    pen.fillStyle = look.ground;
    pen.fillRect(left, top, right - left, bottom - top);
    pen.strokeStyle = look.grid;
    pen.lineWidth = 1;
    const step = niceStep(Math.max(east, north));
    for (let place = step; place < east; place += step) this.line(this.at(place, 0), this.at(place, north));
    for (let place = step; place < north; place += step) this.line(this.at(0, place), this.at(east, place));
    pen.strokeStyle = look.ink;
    pen.globalAlpha = 0.5;
    pen.strokeRect(left, top, right - left, bottom - top);
    pen.globalAlpha = 1;
  }

  drawLinks(moment, state) {
    const { pen, replay } = this;
    pen.lineWidth = 1;
    for (let person = 0; person < replay.people.count; person += 1) {
      const server = moment.servers[person];
      if (server === UNSERVED) continue;
      pen.globalAlpha = isDimmed(state, server) ? 0.05 : 0.4;
      const mast = replay.masts[mastOf(server)]?.positionM;
      const from = server >= 0 ? moment.drones.subarray(3 * server, 3 * server + 2) : mast;
      if (!from) continue;
      pen.strokeStyle = serverColour(state.look, server);
      this.line(this.at(from[0], from[1]), this.at(moment.people[2 * person], moment.people[2 * person + 1]));
    }
    pen.globalAlpha = 1;
  }

  drawStations(moment, state) {
    const { pen, flight } = this;
    pen.lineWidth = 1.2;
    pen.setLineDash([4, 3]);
    for (let index = 0; index < flight.drones.count; index += 1) {
      const [x, y] = this.at(moment.stations[2 * index], moment.stations[2 * index + 1]);
      pen.strokeStyle = droneColour(state.look, index);
      pen.beginPath();
      pen.arc(x, y, this.scale * flight.stations.radiusM, 0, 2 * Math.PI);
      pen.stroke();
    }
    pen.setLineDash([]);
  }

  drawTrails(moment, state) {
    const { pen, flight } = this;
    const { values, size, count } = flight.drones.positions;
    pen.lineWidth = 2;
    pen.lineCap = "round";
    for (let index = 0; index < flight.drones.count; index += 1) {
      pen.strokeStyle = droneColour(state.look, index);
      for (let slot = Math.max(moment.slot - state.trailSlots, 0); slot < moment.slot && slot + 1 < count; slot += 1) {
        const here = slot * size + 3 * index;
        pen.globalAlpha = (isDimmed(state, index) ? 0.2 : 0.8) * (1 - (moment.slot - slot) / (state.trailSlots + 1));
        this.line(this.at(values[here], values[here + 1]), this.at(values[here + size], values[here + size + 1]));
      }
      const last = Math.min(moment.slot, count - 1) * size + 3 * index;
      pen.globalAlpha = isDimmed(state, index) ? 0.2 : 0.8;
      this.line(this.at(values[last], values[last + 1]), this.at(moment.drones[3 * index], moment.drones[3 * index + 1]));
    }
    pen.globalAlpha = 1;
  }

  drawPeople(moment, state) {
    const { pen } = this;
    for (let person = 0; person < this.replay.people.count; person += 1) {
      const server = moment.servers[person];
      const { colour, shape, size } = personLook(state.look, server, moment.rates[person], state.byRate);
      const [x, y] = this.at(moment.people[2 * person], moment.people[2 * person + 1]);
      pen.globalAlpha = isDimmed(state, server) ? 0.15 : 1;
      drawMark(pen, x, y, shape, size, colour, state.look);
    }
    pen.globalAlpha = 1;
  }

  drawMasts(look) {
    const { pen } = this;
    for (const mast of this.replay.masts) {
      const [x, y] = this.at(mast.positionM[0], mast.positionM[1]);
      pen.strokeStyle = look.ink;
      pen.lineWidth = 2;
      pen.beginPath();
      for (const [dx, dy] of [[-6, 8], [0, -10], [6, 8]]) pen.lineTo(x + dx, y + dy);
      pen.moveTo(x - 4, y + 2);
      pen.lineTo(x + 4, y + 2);
      pen.stroke();
      this.text(mast.name, x, y + 20, look, look.ink);
    }
  }

  drawDrones(moment, state) {
    const { pen, flight } = this;
    for (let index = 0; index < flight.drones.count; index += 1) {
      const [x, y] = this.at(moment.drones[3 * index], moment.drones[3 * index + 1]);
      const isOut = moment.powersW[index] === 0;
      pen.globalAlpha = isDimmed(state, index) ? 0.3 : 1;
      drawDrone(pen, x, y, droneColour(state.look, index), state.look, isOut);
      const told = isOut ? "out of service" : `${numberText(moment.drones[3 * index + 2], 0)} m`;
      this.text(`${flight.drones.names[index]} ${told}`, x, y - 15, state.look, state.look.ink);
    }
    pen.globalAlpha = 1;
  }

  drawScale(look) {
    const { pen, size } = this;
    const step = niceStep(Math.max(...this.replay.areaM) * 1.5);
    const [left, top] = [MARGIN, size.height - 10];
    pen.strokeStyle = look.ink;
    pen.lineWidth = 2;
    pen.beginPath();
    for (const [x, y] of [[0, -4], [0, 0], [step * this.scale, 0], [step * this.scale, -4]]) pen.lineTo(left + x, top + y);
    pen.stroke();
    this.text(lengthText(step), left + (step * this.scale) / 2, top - 5, look, look.ink);
    this.text("N ↑", size.width - MARGIN, 16, look, look.ink);
  }

  line(from, to) {
    this.pen.beginPath();
    this.pen.moveTo(from[0], from[1]);
    this.pen.lineTo(to[0], to[1]);
    this.pen.stroke();
  }

  text(text, x, y, look, colour) {
    const { pen, size } = this;
    const half = pen.measureText(text).width / 2;
    const inside = Math.min(Math.max(x, half + 4), Math.max(size.width - half - 4, half + 4));
    pen.textAlign = "center";
    pen.lineJoin = "round";
    pen.lineWidth = 4;
    pen.strokeStyle = look.ground;
    pen.strokeText(text, inside, Math.max(y, 12));
    pen.fillStyle = colour;
    pen.fillText(text, inside, Math.max(y, 12));
  }
}

/**
 * Whether another drone than a highlighted one serves.
 *
 * @param {object} state
 * @param {number} server
 * @returns {boolean}
 */
export function isDimmed(state, server) {
  return state.highlight >= 0 && server !== state.highlight;
}

function drawMark(pen, x, y, shape, size, colour, look) {
  const half = size / 2;
  pen.beginPath();
  if (shape === SHAPES.cross) {
    for (const side of [-1, 1]) {
      pen.moveTo(x - half, y - side * half);
      pen.lineTo(x + half, y + side * half);
    }
    pen.strokeStyle = colour;
    pen.lineWidth = 2.2;
    pen.stroke();
    return;
  }
  if (shape === SHAPES.square) pen.rect(x - 0.9 * half, y - 0.9 * half, 0.9 * size, 0.9 * size);
  else pen.arc(x, y, half, 0, 2 * Math.PI);
  pen.fillStyle = colour;
  pen.fill();
  pen.strokeStyle = look.edge;
  pen.lineWidth = 1;
  pen.stroke();
  if (shape === SHAPES.ring) {
    pen.beginPath();
    pen.arc(x, y, 0.45 * half, 0, 2 * Math.PI);
    pen.fillStyle = look.ground;
    pen.fill();
  }
}

function drawDrone(pen, x, y, colour, look, isOut) {
  const arm = 8;
  pen.lineWidth = 5;
  for (const stroke of [look.ground, isOut ? look.unserved : colour]) {
    pen.strokeStyle = stroke;
    pen.fillStyle = stroke;
    pen.beginPath();
    for (const side of [-1, 1]) {
      pen.moveTo(x - arm, y - side * arm);
      pen.lineTo(x + arm, y + side * arm);
    }
    pen.stroke();
    const extra = stroke === look.ground ? 2 : 0;
    for (const [dx, dy] of [[-1, -1], [-1, 1], [1, -1], [1, 1]]) {
      pen.beginPath();
      pen.arc(x + dx * arm, y + dy * arm, 4.5 + extra, 0, 2 * Math.PI);
      if (isOut) pen.stroke();
      else pen.fill();
    }
    pen.lineWidth = 2.5;
  }
}
