/** What the marks of the pictures mean. */

import { byId, make, makeSvg } from "./dom.js";
import { droneColour, SHAPES, SIZES } from "./look.js";
import { roundRateText } from "./text.js";

/**
 * Draw the legend anew.
 *
 * @param {object} replay
 * @param {import("./look.js").Look} look
 * @param {boolean} byRate whether colours of people tell their rate
 */
export function showLegend(replay, look, byRate) {
  const drones = Math.max(...replay.flights.map((flight) => flight.drones.count));
  const neutral = byRate ? look.rates[2] : droneColour(look, 0);
  const items = [
    [mark(SHAPES.disc, neutral, 11, look), "served by a drone"],
    ...(drones > look.drones.length
      ? [[mark(SHAPES.ring, neutral, 12, look), "by another drone of the same colour"]]
      : []),
    ...(replay.masts.length ? [[mark(SHAPES.square, byRate ? look.rates[2] : look.mast, 11, look), "served by a mast"]] : []),
    [mark(SHAPES.cross, look.unserved, 11, look), "not served"],
    ...(replay.flights.some((flight) => flight.stations) ? [[circle(look), "circle that a drone is to fly"]] : []),
  ];
  const ends = [...look.bounds.map((bound) => `under ${roundRateText(bound)}`), "more"];
  const rates = ends.map((text, kind) => [
    mark(SHAPES.disc, byRate ? look.rates[kind] : look.mast, SIZES[kind], look),
    text,
  ]);
  byId("legend").replaceChildren(
    list("Marks", items),
    list(byRate ? "Their rate: size and colour" : "Their rate: size", rates),
  );
}

/**
 * The mark of a person.
 *
 * @param {number} shape
 * @param {string} colour
 * @param {number} size
 * @param {import("./look.js").Look} look
 * @returns {SVGElement}
 */
function mark(shape, colour, size, look) {
  const half = size / 2;
  const outline = { stroke: look.edge, "stroke-width": 1 };
  const shapes = {
    [SHAPES.disc]: () => [makeSvg("circle", { r: half, fill: colour, ...outline })],
    [SHAPES.ring]: () => [
      makeSvg("circle", { r: half, fill: colour, ...outline }),
      makeSvg("circle", { r: half * 0.45, fill: look.ground }),
    ],
    [SHAPES.square]: () => [makeSvg("rect", { x: -half * 0.9, y: -half * 0.9, width: size * 0.9, height: size * 0.9, fill: colour, ...outline })],
    [SHAPES.cross]: () => [makeSvg("path", { d: `M${-half} ${-half}L${half} ${half}M${-half} ${half}L${half} ${-half}`, stroke: colour, "stroke-width": 2.2 })],
  };
  return makeSvg("svg", { viewBox: "-8 -8 16 16", "aria-hidden": "true" }, ...shapes[shape]());
}

function circle(look) {
  const line = { r: 7, fill: "none", stroke: droneColour(look, 0), "stroke-width": 1.5, "stroke-dasharray": "3 2" };
  return makeSvg("svg", { viewBox: "-8 -8 16 16", "aria-hidden": "true" }, makeSvg("circle", line));
}

function list(name, items) {
  const entries = items.map(([symbol, text]) => make("li", {}, symbol, text));
  return make("div", {}, make("h3", {}, name), make("ul", {}, ...entries));
}
