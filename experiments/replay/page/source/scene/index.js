/** A flight in three dimensions. The bundle of this folder carries three.js, and is unpacked only where WebGL is. */

import { AmbientLight, DirectionalLight, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { Drones } from "./drones.js";
import { Ground } from "./ground.js";
import { Labels } from "./labels.js";
import { People } from "./people.js";
import { Space } from "./space.js";

const VIEW_DEG = 36;
const LOWEST_VIEW_RAD = (86 * Math.PI) / 180;
const FIRST_DIRECTION = new Vector3(-0.32, 0.72, 0.95).normalize();
const TURN_RAD = Math.PI / 24;
const ZOOM = 0.85;
const REACH = 14;
/** Share of the picture that the area fills at first. */
const FILLED = 0.93;

/** Draws moments of one flight. */
export class Scene3d {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLElement} labelBox where names are put
   * @param {object} replay
   * @param {object} flight
   * @throws {Error} there is no WebGL
   */
  constructor(canvas, labelBox, replay, flight) {
    this.canvas = canvas;
    this.replay = replay;
    this.space = new Space(replay);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(VIEW_DEG, 1, this.space.sizeM / 100, this.space.sizeM * 20);
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.labels = new Labels(labelBox);
    this.ground = new Ground(replay, this.space, this.labels);
    this.people = new People(replay, this.space);
    this.drones = new Drones(flight, this.space, this.labels);
    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.set(-1, 3, 2);
    this.scene.add(new AmbientLight(0xffffff, 1.7), sun);
    this.scene.add(this.ground.root, this.people.root, this.drones.root);
    this.shown = null;
    this.onCamera = () => {};
    this.onLost = () => {};
    this.takeOrbit();
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.onLost();
    });
  }

  /** Take the size of the page's box. */
  resize(width, height, pixelRatio) {
    if (!width || !height) return;
    this.size = { width, height };
    this.renderer.setPixelRatio(pixelRatio);
    this.renderer.setSize(width, height, false);
    this.drones.setResolution(width, height);
    this.people.setPixelRatio(pixelRatio);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (!this.wasMoved) this.resetCamera();
  }

  /**
   * @param {import("../replay.js").Moment} moment
   * @param {object} state what is shown, see `views.js`
   */
  draw(moment, state) {
    if (!this.size) return;
    this.shown = { moment, state };
    this.space.heights = state.heights;
    this.ground.show(state.look);
    this.people.show(moment, state, this.replay);
    this.drones.show(moment, state, this.camera, this.size.height);
    this.renderer.render(this.scene, this.camera);
    this.labels.place(this.camera, this.size);
  }

  /**
   * What lies at a place of the picture.
   *
   * @returns {{kind: "drone"|"person", index: number}|null}
   */
  pick(x, y) {
    if (!this.shown) return null;
    const { drones, people } = this.shown.moment;
    return this.nearest("drone", drones, 3, x, y) ?? this.nearest("person", people, 2, x, y);
  }

  /** Move the camera: `turn` and `tilt` by steps, `zoom` by steps, or `reset`. */
  moveCamera(how, steps) {
    if (how === "reset") {
      this.resetCamera();
      return;
    }
    this.wasMoved = true;
    const way = this.camera.position.clone().sub(this.orbit.target);
    const polar = way.clone().normalize();
    if (how === "zoom") way.multiplyScalar(ZOOM ** steps);
    if (how === "turn") way.applyAxisAngle(this.camera.up, steps * TURN_RAD);
    if (how === "tilt") {
      const angle = Math.acos(polar.y) - steps * TURN_RAD;
      const held = Math.min(Math.max(angle, 0.01), LOWEST_VIEW_RAD);
      const flat = new Vector3(way.x, 0, way.z).normalize().multiplyScalar(way.length() * Math.sin(held));
      way.set(flat.x, way.length() * Math.cos(held), flat.z);
    }
    this.camera.position.copy(this.orbit.target).add(way);
    this.orbit.update();
  }

  /** Look from where another scene does. */
  takeCamera(other) {
    if (!other || this.isTaking) return;
    this.isTaking = true;
    this.wasMoved = other.wasMoved;
    this.camera.position.copy(other.camera.position);
    this.orbit.target.copy(other.orbit.target);
    this.orbit.update();
    this.isTaking = false;
  }

  resetCamera() {
    this.wasMoved = false;
    this.orbit.target.set(0, 0, 0);
    let distance = this.space.sizeM;
    do {
      distance *= 1.04;
      this.camera.position.copy(this.orbit.target).addScaledVector(FIRST_DIRECTION, distance);
      this.orbit.update();
      this.camera.updateMatrixWorld();
    } while (!this.isAreaInSight() && distance < this.orbit.maxDistance);
  }

  /** Whether all corners of the area lie inside the picture, with room for what flies above. */
  isAreaInSight() {
    const point = new Vector3();
    const { eastM, northM, sizeM } = this.space;
    return [0, eastM].every((east) => [0, northM].every((north) => [0, 0.12 * sizeM].every((heightM) => {
      this.space.put(point, east, north, heightM / this.space.heights).project(this.camera);
      return Math.abs(point.x) < FILLED && Math.abs(point.y) < FILLED;
    })));
  }

  takeOrbit() {
    this.orbit = new OrbitControls(this.camera, this.canvas);
    this.orbit.maxPolarAngle = LOWEST_VIEW_RAD;
    this.orbit.minDistance = this.space.sizeM * 0.1;
    this.orbit.maxDistance = this.space.sizeM * 6;
    // One finger up or down scrolls the page, as everywhere else on it.
    this.canvas.style.touchAction = "pan-y";
    // The wheel scrolls the page until somebody has clicked into the picture.
    this.orbit.enableZoom = false;
    this.canvas.addEventListener("focus", () => { this.orbit.enableZoom = true; });
    this.canvas.addEventListener("blur", () => { this.orbit.enableZoom = false; });
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.focus({ preventScroll: true });
      if (event.pointerType === "touch") this.orbit.enableZoom = true;
    });
    this.orbit.addEventListener("start", () => { this.wasMoved = true; });
    this.orbit.addEventListener("change", () => {
      if (this.isTaking) return;
      if (this.shown) this.draw(this.shown.moment, this.shown.state);
      this.onCamera();
    });
  }

  nearest(kind, places, stride, x, y) {
    let best = null;
    let least = REACH;
    const point = new Vector3();
    for (let index = 0; index * stride < places.length; index += 1) {
      const up = stride === 3 ? places[3 * index + 2] : 0;
      this.space.put(point, places[stride * index], places[stride * index + 1], up).project(this.camera);
      const left = ((point.x + 1) / 2) * this.size.width;
      const top = ((1 - point.y) / 2) * this.size.height;
      const distance = Math.hypot(left - x, top - y);
      if (distance < least && point.z < 1) {
        least = distance;
        best = { kind, index };
      }
    }
    return best;
  }
}
