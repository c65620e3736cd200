/** Drones with their altitudes, trails, and the circles that they fly. */

import { BoxGeometry, Color, CylinderGeometry, Group, Mesh, MeshLambertMaterial, SphereGeometry, Vector3 } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

import { droneColour } from "../look.js";
import { isDimmed } from "../map2d.js";
import { numberText } from "../text.js";
import { Lines } from "./lines.js";

const SPAN_PX = 32;
const TRAIL_PX = 2.5;
const MOST_TRAIL_SLOTS = 120;
const SIDES = 48;
const ROTORS = [[1, 1], [1, -1], [-1, 1], [-1, -1]];

export class Drones {
  /**
   * @param {object} flight
   * @param {import("./space.js").Space} space
   * @param {import("./labels.js").Labels} labels
   */
  constructor(flight, space, labels) {
    const { count, names } = flight.drones;
    this.flight = flight;
    this.space = space;
    this.root = new Group();
    this.bodies = names.map(() => buildBody());
    this.labels = names.map((name) => labels.add(name, "drone"));
    this.stems = new Lines(2 * count);
    this.circles = new Lines(flight.stations ? (count * SIDES) / 2 : 1);
    this.buildTrails(count * MOST_TRAIL_SLOTS);
    this.root.add(this.stems.root, this.circles.root, this.trails, ...this.bodies.map(({ root }) => root));
    for (const one of [this.stems.root, this.circles.root, this.trails]) one.renderOrder = 4;
    this.point = new Vector3();
    this.colour = new Color();
    this.ground = new Color();
  }

  setResolution(width, height) {
    this.trails.material.resolution.set(width, height);
  }

  show(moment, state, camera, height) {
    this.showBodies(moment, state, camera, height);
    this.showStems(moment, state);
    this.showCircles(moment, state);
    this.showTrails(moment, state);
  }

  showBodies(moment, state, camera, height) {
    const perPixel = (2 * Math.tan((camera.fov * Math.PI) / 360)) / height;
    this.bodies.forEach(({ root, material }, index) => {
      const [eastM, northM, upM] = moment.drones.subarray(3 * index, 3 * index + 3);
      const isOut = moment.powersW[index] === 0;
      this.space.put(root.position, eastM, northM, upM);
      root.scale.setScalar(SPAN_PX * perPixel * camera.position.distanceTo(root.position));
      material.color.set(isOut ? state.look.unserved : droneColour(state.look, index));
      material.opacity = isDimmed(state, index) ? 0.3 : 1;
      const told = isOut ? "out of service" : `${numberText(upM, 0)} m`;
      const text = `${this.flight.drones.names[index]} · ${told}`;
      const label = this.labels[index];
      if (label.element.textContent !== text) label.element.textContent = text;
      label.element.classList.toggle("dimmed", isDimmed(state, index));
      label.set = (point) => {
        point.copy(root.position);
        point.y += 0.95 * root.scale.y;
      };
    });
  }

  /** How high a drone is, as a line down to the ground, with a cross below. */
  showStems(moment, state) {
    const out = 0.006 * this.space.sizeM;
    this.stems.begin();
    for (let index = 0; index < this.flight.drones.count; index += 1) {
      const [eastM, northM, upM] = moment.drones.subarray(3 * index, 3 * index + 3);
      const colour = droneColour(state.look, index);
      const strength = isDimmed(state, index) ? 0.2 : 0.9;
      const at = (east, up) => (array, place) => this.space.write(array, place, east, northM, up);
      this.stems.add(at(eastM, upM), at(eastM, 0), colour, strength);
      this.stems.add(at(eastM - out, 0), at(eastM + out, 0), colour, strength);
    }
    this.stems.end();
  }

  showCircles(moment, state) {
    this.circles.begin();
    if (moment.stations) {
      const { radiusM } = this.flight.stations;
      for (let index = 0; index < this.flight.drones.count; index += 1) {
        const [eastM, northM] = moment.stations.subarray(2 * index, 2 * index + 2);
        const upM = moment.drones[3 * index + 2];
        const at = (side) => (array, place) => {
          const angle = (2 * Math.PI * side) / SIDES;
          this.space.write(array, place, eastM + radiusM * Math.cos(angle), northM + radiusM * Math.sin(angle), upM);
        };
        for (let side = 0; side < SIDES; side += 2) {
          this.circles.add(at(side), at(side + 1), droneColour(state.look, index), isDimmed(state, index) ? 0.1 : 0.8);
        }
      }
    }
    this.circles.end();
  }

  buildTrails(most) {
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions(new Float32Array(6 * most));
    geometry.setColors(new Float32Array(6 * most));
    const material = new LineMaterial({ linewidth: TRAIL_PX, vertexColors: true, depthWrite: false });
    this.trails = new LineSegments2(geometry, material);
    this.trails.frustumCulled = false;
    this.places = geometry.attributes.instanceStart.data;
    this.colours = geometry.attributes.instanceColorStart.data;
  }

  showTrails(moment, state) {
    const { positions } = this.flight.drones;
    const slots = state.trails ? Math.min(state.trailSlots, MOST_TRAIL_SLOTS - 1) : 0;
    const last = Math.min(moment.slot, positions.count - 1);
    let count = 0;
    this.ground.set(state.look.ground);
    for (let index = 0; index < this.flight.drones.count; index += 1) {
      const at = (slot) => positions.values.subarray(slot * positions.size + 3 * index, slot * positions.size + 3 * index + 3);
      const own = isDimmed(state, index) ? 0.2 : 1;
      for (let slot = Math.max(last - slots, 0); slots && slot <= last; slot += 1) {
        const to = slot === last ? moment.drones.subarray(3 * index, 3 * index + 3) : at(slot + 1);
        this.space.write(this.places.array, 6 * count, ...at(slot));
        this.space.write(this.places.array, 6 * count + 3, ...to);
        const strength = own * (1 - (last - slot) / (slots + 1));
        this.colour.set(droneColour(state.look, index)).lerp(this.ground, 1 - strength);
        this.colour.toArray(this.colours.array, 6 * count);
        this.colour.toArray(this.colours.array, 6 * count + 3);
        count += 1;
      }
    }
    this.trails.geometry.instanceCount = count;
    this.places.needsUpdate = true;
    this.colours.needsUpdate = true;
  }
}

/** A quadcopter one unit wide. */
function buildBody() {
  const material = new MeshLambertMaterial({ transparent: true });
  const root = new Group();
  root.renderOrder = 5;
  root.add(new Mesh(new SphereGeometry(0.2, 16, 10).scale(1, 0.7, 1), material));
  for (const side of [1, -1]) {
    root.add(new Mesh(new BoxGeometry(0.95, 0.09, 0.09).rotateY((side * Math.PI) / 4), material));
  }
  for (const [x, z] of ROTORS) {
    root.add(new Mesh(new CylinderGeometry(0.2, 0.2, 0.05, 20).translate(0.335 * x, 0.06, 0.335 * z), material));
  }
  return { root, material };
}
