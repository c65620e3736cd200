/** The area with its grid and scale, and the masts on it. */

import { CylinderGeometry, Group, Mesh, MeshBasicMaterial, MeshLambertMaterial, PlaneGeometry } from "three";

import { niceStep } from "../look.js";
import { lengthText } from "../text.js";
import { Lines } from "./lines.js";

const MOST_LINES = 200;

export class Ground {
  /**
   * @param {object} replay
   * @param {import("./space.js").Space} space
   * @param {import("./labels.js").Labels} labels
   */
  constructor(replay, space, labels) {
    this.space = space;
    this.root = new Group();
    this.floor = new Mesh(
      new PlaneGeometry(space.eastM, space.northM),
      new MeshBasicMaterial({ depthWrite: false }),
    );
    this.floor.rotation.x = -Math.PI / 2;
    this.grid = new Lines(MOST_LINES);
    this.grid.root.renderOrder = 1;
    this.root.add(this.floor, this.grid.root);
    this.step = niceStep(space.sizeM);
    this.labelSides(labels);
    this.masts = replay.masts.map((mast) => this.buildMast(mast, labels));
  }

  show(look) {
    for (const { root, heightM } of this.masts) root.scale.y = (heightM || 1) * this.space.heights;
    if (this.shownLook === look) return;
    this.shownLook = look;
    this.floor.material.color.set(look.ground);
    this.drawGrid(look);
    for (const { root } of this.masts) root.material.color.set(look.mast);
  }

  drawGrid(look) {
    const { eastM, northM } = this.space;
    this.grid.begin();
    const line = (fromEast, fromNorth, toEast, toNorth, colour, strength) => this.grid.add(
      (array, place) => this.space.write(array, place, fromEast, fromNorth, 0),
      (array, place) => this.space.write(array, place, toEast, toNorth, 0),
      colour,
      strength,
    );
    for (let east = this.step; east < eastM; east += this.step) line(east, 0, east, northM, look.grid, 1);
    for (let north = this.step; north < northM; north += this.step) line(0, north, eastM, north, look.grid, 1);
    line(0, 0, eastM, 0, look.ink, 0.6);
    line(0, northM, eastM, northM, look.ink, 0.6);
    line(0, 0, 0, northM, look.ink, 0.6);
    line(eastM, 0, eastM, northM, look.ink, 0.6);
    this.grid.end();
  }

  /** Distances along the southern and the western side, every second line, and where north is. */
  labelSides(labels) {
    const { eastM, northM } = this.space;
    const out = this.space.sizeM * 0.035;
    for (let east = 0; east <= eastM; east += 2 * this.step) {
      labels.add(lengthText(east), "side").set = (point) => this.space.put(point, east, -out, 0);
    }
    for (let north = 2 * this.step; north <= northM; north += 2 * this.step) {
      labels.add(lengthText(north), "side").set = (point) => this.space.put(point, -out, north, 0);
    }
    labels.add("N", "north").set = (point) => this.space.put(point, eastM / 2, northM + out, 0);
  }

  buildMast(mast, labels) {
    const [eastM, northM, heightM] = mast.positionM;
    const width = this.space.sizeM * 0.011;
    const root = new Mesh(new CylinderGeometry(0.3 * width, width, 1, 4).translate(0, 0.5, 0), new MeshLambertMaterial());
    this.space.put(root.position, eastM, northM, 0);
    this.root.add(root);
    labels.add(mast.name, "mast").set = (point) => this.space.put(point, eastM, northM, heightM);
    return { root, heightM };
  }
}
