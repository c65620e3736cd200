/** Pieces of thin lines, each end with a place and a colour, written anew for every picture. */

import { BufferAttribute, BufferGeometry, Color, DynamicDrawUsage, LineBasicMaterial, LineSegments } from "three";

export class Lines {
  /**
   * @param {number} most pieces
   * @param {object} [look] of the material
   */
  constructor(most, look = {}) {
    this.places = dynamic(new Float32Array(6 * most));
    this.colours = dynamic(new Float32Array(8 * most), 4);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.places);
    geometry.setAttribute("color", this.colours);
    const material = new LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false, ...look });
    this.root = new LineSegments(geometry, material);
    this.root.frustumCulled = false;
    this.colour = new Color();
    this.begin();
  }

  begin() {
    this.count = 0;
  }

  /** Add a piece: `write(array, place)` writes each end, and both get a colour and its strength. */
  add(writeFrom, writeTo, colour, strength) {
    writeFrom(this.places.array, 6 * this.count);
    writeTo(this.places.array, 6 * this.count + 3);
    this.colour.set(colour);
    for (const end of [0, 4]) {
      this.colour.toArray(this.colours.array, 8 * this.count + end);
      this.colours.array[8 * this.count + end + 3] = strength;
    }
    this.count += 1;
  }

  end() {
    this.root.geometry.setDrawRange(0, 2 * this.count);
    this.places.needsUpdate = true;
    this.colours.needsUpdate = true;
  }
}

/**
 * An attribute that is written often.
 *
 * @param {Float32Array} array
 * @param {number} [size] numbers of an item
 * @returns {BufferAttribute}
 */
export function dynamic(array, size = 3) {
  return new BufferAttribute(array, size).setUsage(DynamicDrawUsage);
}
