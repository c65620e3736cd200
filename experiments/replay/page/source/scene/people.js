/** People as marks on the ground, and links to those who serve them. */

import { BufferGeometry, Color, Group, Points, ShaderMaterial } from "three";

import { personLook, serverColour } from "../look.js";
import { isDimmed } from "../map2d.js";
import { mastOf, UNSERVED } from "../replay.js";
import { dynamic, Lines } from "./lines.js";

const LINK_STRENGTH = 0.42;
const DIMMED = { link: 0.04, mark: 0.15 };

const VERTEX = `
  attribute vec4 tint;
  attribute vec2 mark;
  uniform float pixelRatio;
  varying vec4 vTint;
  varying float vShape;
  varying float vSize;
  void main() {
    vTint = tint;
    vShape = mark.x;
    vSize = (mark.y + 2.0) * pixelRatio;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    gl_PointSize = vSize;
  }`;

// Distances to the border of each shape of look.js, in pixels.
const FRAGMENT = `
  uniform vec3 edge;
  uniform vec3 ground;
  uniform float pixelRatio;
  varying vec4 vTint;
  varying float vShape;
  varying float vSize;
  void main() {
    vec2 place = (gl_PointCoord - 0.5) * vSize;
    float radius = 0.5 * vSize - pixelRatio;
    float inside = radius - length(place);
    if (vShape > 1.5) inside = 0.9 * radius - max(abs(place.x), abs(place.y));
    if (vShape > 2.5) {
      float stroke = abs(abs(place.x) - abs(place.y)) * 0.7071;
      inside = min(1.1 * pixelRatio - stroke, radius - max(abs(place.x), abs(place.y)));
    }
    float cover = clamp(inside + 0.5 * pixelRatio + 0.5, 0.0, 1.0);
    if (cover <= 0.0) discard;
    vec3 colour = vTint.rgb;
    if (vShape < 2.5) colour = mix(edge, colour, clamp(inside - 0.5 * pixelRatio + 0.5, 0.0, 1.0));
    if (vShape > 0.5 && vShape < 1.5) {
      colour = mix(colour, ground, clamp(0.45 * radius - length(place) + 0.5, 0.0, 1.0));
    }
    gl_FragColor = vec4(colour, vTint.a * cover);
    #include <colorspace_fragment>
  }`;

export class People {
  /**
   * @param {object} replay
   * @param {import("./space.js").Space} space
   */
  constructor(replay, space) {
    const { count } = replay.people;
    this.space = space;
    this.root = new Group();
    this.links = new Lines(count);
    this.places = dynamic(new Float32Array(3 * count));
    this.tints = dynamic(new Float32Array(4 * count), 4);
    this.marks = dynamic(new Float32Array(2 * count), 2);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.places);
    geometry.setAttribute("tint", this.tints);
    geometry.setAttribute("mark", this.marks);
    this.material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { pixelRatio: { value: 1 }, edge: { value: new Color() }, ground: { value: new Color() } },
      transparent: true,
      depthWrite: false,
    });
    const points = new Points(geometry, this.material);
    points.frustumCulled = false;
    points.renderOrder = 3;
    this.links.root.renderOrder = 2;
    this.root.add(this.links.root, points);
    this.colour = new Color();
  }

  /** @param {number} pixelRatio pixels of the canvas in one of CSS */
  setPixelRatio(pixelRatio) {
    this.material.uniforms.pixelRatio.value = pixelRatio;
  }

  show(moment, state, replay) {
    const { look, byRate } = state;
    this.material.uniforms.edge.value.set(look.edge);
    this.material.uniforms.ground.value.set(look.ground);
    this.links.begin();
    for (let person = 0; person < replay.people.count; person += 1) {
      const server = moment.servers[person];
      const [eastM, northM] = moment.people.subarray(2 * person, 2 * person + 2);
      this.space.write(this.places.array, 3 * person, eastM, northM, 0);
      const { colour, shape, size } = personLook(look, server, moment.rates[person], byRate);
      const dimmed = isDimmed(state, server);
      this.colour.set(colour).toArray(this.tints.array, 4 * person);
      this.tints.array[4 * person + 3] = dimmed ? DIMMED.mark : 1;
      this.marks.array.set([shape, size], 2 * person);
      if (state.links && server !== UNSERVED) this.link(moment, replay, server, [eastM, northM], look, dimmed);
    }
    this.links.end();
    for (const attribute of [this.places, this.tints, this.marks]) attribute.needsUpdate = true;
  }

  link(moment, replay, server, [eastM, northM], look, dimmed) {
    const from = server >= 0
      ? moment.drones.subarray(3 * server, 3 * server + 3)
      : replay.masts[mastOf(server)]?.positionM;
    if (!from) return;
    this.links.add(
      (array, place) => this.space.write(array, place, from[0], from[1], from[2]),
      (array, place) => this.space.write(array, place, eastM, northM, 0),
      serverColour(look, server),
      dimmed ? DIMMED.link : LINK_STRENGTH,
    );
  }
}
