/**
 * How people and drones look, the same in both views and in the legend. Colours come from the
 * style sheet, so that each is written once, for light and for dark.
 */

import { mastOf, UNSERVED } from "./replay.js";

export const SHAPES = { disc: 0, ring: 1, square: 2, cross: 3 };

/** Shares of all rates below the bounds between their classes, before those are rounded. */
const RATE_SHARES = [0.08, 0.3, 0.6, 0.9];
const ROUND = [1, 1.5, 2, 3, 4, 5, 6, 8, 10];

/** Diameters of people by the class of their rate, in pixels of CSS. */
export const SIZES = [5.5, 7, 8.5, 10.5, 12.5];
const CROSS_SIZE = 10;

/**
 * Round bounds between at most five classes of the rates that occur.
 *
 * @param {object} replay
 * @returns {number[]} bit/s
 */
export function rateBounds(replay) {
  const rates = Float64Array.from(replay.flights.flatMap(({ rates: { values } }) => Array.from(values.filter((rate) => rate > 0))));
  rates.sort();
  const bounds = RATE_SHARES.map((share) => rounded(rates[Math.floor(share * rates.length)] ?? 1e6));
  return [...new Set(bounds)];
}

/**
 * @typedef {object} Look
 * @property {string[]} drones colours, used over and over where there are more drones
 * @property {string[]} rates colours by class
 * @property {number[]} bounds between the classes of rates, bit/s
 * @property {string} ink
 * @property {string} ground
 * @property {string} grid
 * @property {string} edge outline of people
 * @property {string} mast
 * @property {string} unserved
 */

/**
 * The colours of the page as it is now.
 *
 * @param {number[]} bounds between classes of rates
 * @returns {Look}
 */
export function readLook(bounds) {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  const series = (name) => {
    const found = [];
    while (colour(`${name}-${found.length}`)) found.push(colour(`${name}-${found.length}`));
    return found;
  };
  const [ink, ground, grid, edge, mast, unserved] =
    ["ink", "ground", "grid", "edge", "mast", "unserved"].map(colour);
  return { drones: series("drone"), rates: series("rate"), bounds, ink, ground, grid, edge, mast, unserved };
}

/**
 * @param {Look} look
 * @param {number} index
 * @returns {string}
 */
export function droneColour(look, index) {
  return look.drones[index % look.drones.length];
}

/**
 * The colour of whoever serves.
 *
 * @param {Look} look
 * @param {number} server as in the document
 * @returns {string}
 */
export function serverColour(look, server) {
  if (server >= 0) return droneColour(look, server);
  return server === UNSERVED ? look.unserved : look.mast;
}

/**
 * @param {Look} look
 * @param {number} rateBps
 * @returns {number} 0 for the slowest
 */
function rateClass(look, rateBps) {
  return look.bounds.filter((bound) => rateBps >= bound).length;
}

function rounded(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * ROUND.find((factor) => value <= factor * power * 1.1);
}

/**
 * How a person is drawn. Who serves is told by the shape as well as by the colour.
 *
 * @param {Look} look
 * @param {number} server as in the document
 * @param {number} rateBps
 * @param {boolean} byRate whether the colour tells the rate instead of the server
 * @returns {{colour: string, shape: number, size: number}}
 */
export function personLook(look, server, rateBps, byRate) {
  if (server === UNSERVED) return { colour: look.unserved, shape: SHAPES.cross, size: CROSS_SIZE };
  const kind = rateClass(look, rateBps);
  const colour = byRate ? look.rates[kind] : serverColour(look, server);
  if (mastOf(server) >= 0) return { colour, shape: SHAPES.square, size: SIZES[kind] };
  const isSecond = Math.floor(server / look.drones.length) % 2 === 1;
  return { colour, shape: isSecond ? SHAPES.ring : SHAPES.disc, size: SIZES[kind] };
}

/**
 * A step of a grid that gives between four and ten cells.
 *
 * @param {number} lengthM
 * @returns {number}
 */
export function niceStep(lengthM) {
  const rough = lengthM / 8;
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= rough);
}
