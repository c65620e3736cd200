/** Unpacks the arrays of a document; `experiments/replay/packing.py` packs them and says how. */

const READERS = {
  uint8: [1, (view, at) => view.getUint8(at)],
  int8: [1, (view, at) => view.getInt8(at)],
  int16: [2, (view, at) => view.getInt16(at, true)],
  int32: [4, (view, at) => view.getInt32(at, true)],
  float32: [4, (view, at) => view.getFloat32(at, true)],
};

/**
 * An array whose first axis is time; one with a single state stays as it is for all time.
 *
 * @typedef {object} States
 * @property {Float64Array} values all states, one after the other
 * @property {number} size numbers of a state
 * @property {number} count states
 */

/**
 * @param {object} array a `Packed`
 * @returns {Promise<States>}
 */
export async function unpack(array) {
  const numbers = readNumbers(await inflate(array.packed), array);
  const scale = array.scale ?? 1;
  const meaning = array.ratio
    ? (number) => (number === 0 ? 0 : array.ratio ** number)
    : (number) => number * scale;
  const count = array.shape.length > 1 ? array.shape[0] : 1;
  return { values: numbers.map(meaning), size: numbers.length / count, count };
}

/**
 * Where a state begins in `values`.
 *
 * @param {States} states
 * @param {number} slot
 * @returns {number}
 */
export function startOf(states, slot) {
  return Math.min(slot, states.count - 1) * states.size;
}

/**
 * Bytes that were compressed by zlib and written in base64.
 *
 * @param {string} text
 * @returns {Promise<ArrayBuffer>}
 */
export async function inflate(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(unpacked).arrayBuffer();
}

/** The numbers without scale or ratio. */
function readNumbers(content, { type, shape, series }) {
  const [width, read] = READERS[type];
  const size = shape.reduce((product, side) => product * side, 1);
  const first = series ? size / shape[0] : 0;
  const expected = 4 * first + width * (size - first);
  if (content.byteLength !== expected) {
    throw new Error(`An array of ${shape.join(" × ")} has ${content.byteLength} bytes instead of ${expected}.`);
  }
  const view = new DataView(content);
  if (series) return addUp(view, first, shape[0], width, read);
  return Float64Array.from({ length: size }, (_, place) => read(view, width * place));
}

/** States from the first one, and from the differences of each of its numbers. */
function addUp(view, size, count, width, read) {
  const numbers = new Float64Array(size * count);
  let at = 4 * size;
  for (let number = 0; number < size; number += 1) {
    let value = view.getInt32(4 * number, true);
    numbers[number] = value;
    for (let state = 1; state < count; state += 1) {
      value += read(view, at);
      at += width;
      numbers[state * size + number] = value;
    }
  }
  return numbers;
}
