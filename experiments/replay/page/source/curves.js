/** Metrics as curves: one plot each, all flights in it, with a cursor at the common time. */

import { byId, make, makeSvg, setText } from "./dom.js";
import { metricAt, metricMean } from "./replay.js";
import { numberText } from "./text.js";

const HEIGHT = 100;
const BETTER = { higher: "↑ better", lower: "↓ better" };
/** Differences of less than this share of a metric are not blown up to the whole height. */
const LEAST_WIDTH = 0.04;

/**
 * Build all plots.
 *
 * @param {object} replay
 * @param {import("./player.js").Player} player is sought by pointing at a plot
 * @returns {() => void} shows the slot that the player is at
 */
export function buildCurves(replay, player) {
  byId("curve-names").append(
    ...replay.flights.map(({ label }, index) => make("li", {}, flightMark(index), make("bdi", {}, label))),
  );
  const shows = replay.metrics.map((metric) => buildPlot(metric, replay, player));
  return () => shows.forEach((show) => show(player.shownTime, player.slot));
}

function buildPlot(metric, replay, player) {
  const { slots, flights } = replay;
  const [low, high] = niceRange(flights.flatMap((flight) => [...(flight.metrics.get(metric.key) ?? [])]));
  const heightOf = (value) => HEIGHT * (1 - (value - low) / (high - low));
  const cursor = makeSvg("line", { class: "cursor", y1: 0, y2: HEIGHT });
  const svg = makeSvg(
    "svg",
    { viewBox: `0 0 ${slots} ${HEIGHT}`, preserveAspectRatio: "none", "aria-hidden": "true" },
    ...[0, 0.5, 1].map((share) =>
      makeSvg("line", { class: "rule", x1: 0, x2: slots, y1: share * HEIGHT, y2: share * HEIGHT }),
    ),
    ...flights.map((flight, index) =>
      makeSvg("path", { class: `curve flight-${index}`, d: pathOf(flight, metric.key, slots, heightOf) }),
    ),
    cursor,
  );
  const plot = make("div", { class: "plot" }, svg);
  for (const [value, place] of [[high, "high"], [low, "low"]]) {
    plot.append(make("span", { class: `tick ${place}`, "aria-hidden": "true" }, tickText(value, high - low)));
  }
  seekByPointer(svg, plot, player);

  const readouts = flights.map((flight, index) => buildReadout(metric, flight, index));
  const notes = [metric.unit, BETTER[metric.better]].filter(Boolean).join(", ");
  byId("metrics").append(
    make(
      "section",
      { class: "metric", "data-metric": metric.key },
      make("h3", {}, make("bdi", {}, metric.label), make("span", { class: "quiet" }, notes && ` ${notes}`)),
      make("dl", { class: "readouts" }, ...readouts.map((readout) => readout.element)),
      plot,
    ),
  );
  return (time, slot) => {
    cursor.setAttribute("x1", String(time));
    cursor.setAttribute("x2", String(time));
    readouts.forEach((readout) => readout.show(slot));
  };
}

function buildReadout(metric, flight, index) {
  const value = make("data", { value: "" });
  const mean = numberText(metricMean(flight, metric.key), metric.digits);
  const element = make(
    "div",
    { class: `readout flight-${index}` },
    make("dt", { title: flight.label }, flightMark(index), make("span", { class: "hidden" }, flight.label)),
    make("dd", {}, value, make("span", { class: "quiet" }, ` mean ${mean}`)),
  );
  const show = (slot) => {
    const number = metricAt(flight, metric.key, slot);
    value.value = Number.isFinite(number) ? String(number) : "";
    setText(value, numberText(number, metric.digits));
  };
  return { element, show };
}

/**
 * A piece of a flight's line, as the plots have it.
 *
 * @param {number} index of the flight
 * @returns {SVGElement}
 */
export function flightMark(index) {
  const line = makeSvg("path", { class: `curve flight-${index}`, d: "M0 5H26" });
  return makeSvg("svg", { class: "flight-mark", viewBox: "0 0 26 10", "aria-hidden": "true" }, line);
}

function seekByPointer(svg, plot, player) {
  const seek = (event) => {
    const box = svg.getBoundingClientRect();
    player.seek(((event.clientX - box.left) / box.width) * player.slots);
  };
  plot.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    player.pause();
    plot.setPointerCapture(event.pointerId);
    seek(event);
  });
  plot.addEventListener("pointermove", (event) => {
    if (plot.hasPointerCapture(event.pointerId)) seek(event);
  });
}

/** A metric is that of a slot, drawn at the slot's end; what is no number leaves a gap. */
function pathOf(flight, key, slots, heightOf) {
  let path = "";
  let isDrawing = false;
  for (let slot = 1; slot <= slots; slot += 1) {
    const value = metricAt(flight, key, slot);
    if (Number.isFinite(value)) {
      path += `${isDrawing ? "L" : "M"}${slot} ${heightOf(value).toFixed(2)}`;
      isDrawing = true;
    } else {
      isDrawing = false;
    }
  }
  return path;
}

function niceRange(values) {
  const finite = values.filter(Number.isFinite);
  if (!finite.length) return [0, 1];
  let [least, most] = finite.reduce(
    ([low, high], value) => [Math.min(low, value), Math.max(high, value)],
    [Infinity, -Infinity],
  );
  const missing = LEAST_WIDTH * Math.max(Math.abs(least), Math.abs(most)) - (most - least);
  if (missing > 0) least -= missing;
  const width = most - least || 1;
  const power = 10 ** Math.floor(Math.log10(width));
  const step = [0.1, 0.2, 0.5, 1].map((factor) => factor * power).find((one) => one >= width / 10);
  const low = Math.floor(least / step + 1e-9) * step;
  const high = Math.ceil(most / step - 1e-9) * step;
  return low < high ? [low, high] : [low - step, high + step];
}

function tickText(value, width) {
  const digits = Math.max(0, Math.ceil(1 - Math.log10(width)));
  return Number(value.toFixed(Math.min(digits, 12))).toLocaleString("en", { maximumFractionDigits: 12 });
}
