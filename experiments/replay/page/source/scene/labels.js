/** Names at places of the scene, as elements above the picture. */

import { Vector3 } from "three";

/** A character is about so wide. */
const CHARACTER_PX = 7.4;

export class Labels {
  /** @param {HTMLElement} box */
  constructor(box) {
    this.box = box;
    this.all = [];
    this.point = new Vector3();
  }

  /**
   * @param {string} text
   * @param {string} kind a class of the style sheet
   * @returns {{element: HTMLElement, set: (point: Vector3) => void}} `set` says where it is
   */
  add(text, kind) {
    const element = document.createElement("span");
    element.className = `label ${kind}`;
    element.textContent = text;
    this.box.append(element);
    const label = { element, set: () => {} };
    this.all.push(label);
    return label;
  }

  /** Put all of them where they belong. */
  place(camera, { width, height }) {
    for (const { element, set } of this.all) {
      set(this.point);
      this.point.project(camera);
      element.hidden = this.point.z > 1 || Math.abs(this.point.x) > 1.1 || Math.abs(this.point.y) > 1.1;
      // Names stay inside the picture as a whole, as long as their places do.
      const half = Math.min((element.textContent.length * CHARACTER_PX) / 2, width / 2);
      const left = Math.min(Math.max(((this.point.x + 1) / 2) * width, half), width - half);
      const top = ((1 - this.point.y) / 2) * height;
      element.style.transform = `translate(-50%, -50%) translate(${left.toFixed(1)}px, ${top.toFixed(1)}px)`;
    }
  }
}
