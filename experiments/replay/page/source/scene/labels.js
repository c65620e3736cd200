/** Names at places of the scene, as elements above the picture. */

import { Vector3 } from "three";

/** A character is about so wide. */
const CHARACTER_PX = 7.4;
const LINE_PX = 14;

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
   * @returns {{element: HTMLElement, kind: string, set: (point: Vector3) => void}} `set` says where it is
   */
  add(text, kind) {
    const element = document.createElement("span");
    element.className = `label ${kind}`;
    element.textContent = text;
    this.box.append(element);
    const label = { element, kind, set: () => {} };
    this.all.push(label);
    return label;
  }

  /** Put all of them where they belong; names of drones that would lie on each other are piled up. */
  place(camera, { width, height }) {
    const placed = [];
    for (const { element, kind, set } of this.all) {
      set(this.point);
      this.point.project(camera);
      element.hidden = this.point.z > 1 || Math.abs(this.point.x) > 1.1 || Math.abs(this.point.y) > 1.1;
      if (element.hidden) continue;
      // Names stay inside the picture as a whole, as long as their places do.
      const half = Math.min((element.textContent.length * CHARACTER_PX) / 2, width / 2);
      const label = {
        element,
        half,
        left: Math.min(Math.max(((this.point.x + 1) / 2) * width, half), width - half),
        top: ((1 - this.point.y) / 2) * height,
      };
      if (kind === "drone") placed.push(label);
      else move(label);
    }
    placed.sort((one, other) => other.top - one.top);
    placed.forEach((label, index) => {
      for (const below of placed.slice(0, index)) {
        const isBeside = Math.abs(label.left - below.left) > label.half + below.half;
        if (!isBeside && Math.abs(label.top - below.top) < LINE_PX) label.top = below.top - LINE_PX;
      }
      move(label);
    });
  }
}

function move({ element, left, top }) {
  element.style.transform = `translate(-50%, -50%) translate(${left.toFixed(1)}px, ${top.toFixed(1)}px)`;
}
