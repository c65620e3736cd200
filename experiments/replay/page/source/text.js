/** Numbers and names as people read them. */

const NO_NUMBER = "–";
const LONGEST_NAME = 60;
const RATE_UNITS = [["Gbit/s", 1e9], ["Mbit/s", 1e6], ["kbit/s", 1e3]];

/**
 * A name from outside on one line: shortened, without characters that cannot be seen.
 *
 * @param {unknown} text
 * @param {number} [longest] characters
 * @returns {string}
 */
export function plain(text, longest = LONGEST_NAME) {
  // More than `longest` code units are enough for as many characters.
  const characters = Array.from(String(text ?? "").slice(0, 4 * longest));
  const shown = characters.slice(0, longest).join("").replace(/[\p{Cc}\p{Cs}\p{Zl}\p{Zp}]/gu, "�")
    .replace(/(?!\u200d)\p{Cf}/gu, "�");
  return shown + (characters.length > longest ? "…" : "");
}

/**
 * A number with so many digits after the point, or a dash where there is none.
 *
 * @param {number} value
 * @param {number} digits
 * @returns {string}
 */
export function numberText(value, digits) {
  if (!Number.isFinite(value)) return NO_NUMBER;
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/**
 * Such as 12.3 Mbit/s or 840 kbit/s.
 *
 * @param {number} rateBps
 * @returns {string}
 */
export function rateText(rateBps) {
  if (!Number.isFinite(rateBps)) return NO_NUMBER;
  for (const [unit, size] of RATE_UNITS) {
    if (rateBps >= 0.9995 * size) return `${threeDigits(rateBps / size)}\u00a0${unit}`;
  }
  return `${Math.round(rateBps)}\u00a0bit/s`;
}

/**
 * The same without zeros at the end, for rates that are round.
 *
 * @param {number} rateBps
 * @returns {string}
 */
export function roundRateText(rateBps) {
  const [number, unit] = rateText(rateBps).split("\u00a0");
  return `${Number(number)}\u00a0${unit}`;
}

function threeDigits(value) {
  return value >= 1000 ? String(Math.round(value)) : value.toPrecision(3);
}

/**
 * Such as 85 m or 1.2 km.
 *
 * @param {number} lengthM
 * @returns {string}
 */
export function lengthText(lengthM) {
  if (lengthM < 1000) return `${Number(lengthM.toPrecision(3))}\u00a0m`;
  return `${Number((lengthM / 1000).toPrecision(3))}\u00a0km`;
}

/**
 * Minutes and seconds, such as 2:30.
 *
 * @param {number} seconds
 * @returns {string}
 */
export function clockText(seconds) {
  const whole = Math.round(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/**
 * A number and what it counts.
 *
 * @param {number} count
 * @param {string} one
 * @param {string} many
 * @returns {string}
 */
export function countText(count, one, many) {
  return `${count.toLocaleString("en")}\u00a0${count === 1 ? one : many}`;
}
