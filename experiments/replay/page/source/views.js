/** The picture of each flight: in three dimensions where WebGL is there, else from above. */

import { flightMark } from "./curves.js";
import { inflate } from "./decode.js";
import { byId, make, setText } from "./dom.js";
import { Map2d } from "./map2d.js";
import { momentOf, serverName } from "./replay.js";
import { serviceText } from "./tables.js";
import { numberText, rateText } from "./text.js";

const NO_WEBGL = "This browser shows no 3-D graphics (WebGL is missing or switched off): here is the view from above.";
const LOST_WEBGL = "The graphics card stopped the 3-D view: here is the view from above.";
const CAMERA_BUTTONS = [
  ["turn", 1, "⟲", "Turn left"],
  ["turn", -1, "⟳", "Turn right"],
  ["tilt", 1, "⤒", "Look more from above"],
  ["tilt", -1, "⤓", "Look more from the side"],
  ["zoom", 1, "+", "Closer"],
  ["zoom", -1, "−", "Farther away"],
  ["reset", 0, "⌂", "Camera as at first"],
];

/** All pictures of a replay. What they show is decided by `state`, which `controls.js` changes. */
export class Views {
  /**
   * @param {object} replay
   * @param {import("./player.js").Player} player
   * @param {object} state `look`, `byRate`, `links`, `trails`, `trailSlots`, `highlight` (a drone
   *   or -1), `heights` (how many times as high altitudes are drawn)
   */
  constructor(replay, player, state) {
    this.replay = replay;
    this.player = player;
    this.state = state;
    this.is3d = false;
    this.has3d = false;
    this.stages = replay.flights.map((flight, index) => this.buildStage(flight, index));
    this.resizing = new ResizeObserver(() => this.resize());
    for (const stage of this.stages) this.resizing.observe(stage.box);
  }

  /** Unpack and start what draws in three dimensions. */
  async start3d() {
    try {
      if (!hasWebgl()) throw new Error("no WebGL");
      const script = document.createElement("script");
      script.textContent = new TextDecoder().decode(await inflate(byId("scene-script").textContent.trim()));
      document.head.append(script);
      for (const stage of this.stages) {
        stage.scene = new globalThis.orchidScene.Scene3d(stage.canvas3d, stage.labels, this.replay, stage.flight);
        stage.scene.onCamera = () => this.copyCamera(stage);
        stage.scene.onLost = () => this.lose3d(LOST_WEBGL);
      }
      this.has3d = true;
    } catch (problem) {
      this.lose3d(NO_WEBGL);
    }
  }

  /** @param {boolean} is3d whether to show three dimensions */
  choose(is3d) {
    this.is3d = is3d && this.has3d;
    for (const { box } of this.stages) box.classList.toggle("is-3d", this.is3d);
    this.resize();
  }

  /** Show the player's time. */
  draw() {
    for (const stage of this.stages) {
      const moment = momentOf(this.replay, stage.flight, this.player.shownTime);
      (this.is3d ? stage.scene : stage.map).draw(moment, this.state);
    }
  }

  /** Say who is served; less often than pictures are drawn. */
  tell() {
    for (const stage of this.stages) {
      setText(stage.service, serviceText(momentOf(this.replay, stage.flight, this.player.slot), this.replay));
    }
  }

  /** Move all cameras: `turn` and `tilt` by steps, `zoom` by steps, or `reset`. */
  moveCamera(how, steps) {
    if (!this.is3d) return;
    this.stages[0].scene.moveCamera(how, steps);
    this.copyCamera(this.stages[0]);
  }

  copyCamera(from) {
    for (const stage of this.stages) if (stage !== from) stage.scene?.takeCamera(from.scene);
    if (this.is3d && !this.player.isPlaying) this.draw();
  }

  lose3d(reason) {
    this.has3d = false;
    byId("view-3d").disabled = true;
    byId("view-2d").checked = true;
    this.notice(reason);
    this.choose(false);
  }

  /** @param {string} text what people should know about the pictures */
  notice(text) {
    byId("notice").hidden = false;
    setText(byId("notice"), text);
  }

  resize() {
    for (const stage of this.stages) {
      const { clientWidth, clientHeight } = stage.box;
      (this.is3d ? stage.scene : stage.map).resize(clientWidth, clientHeight, Math.min(devicePixelRatio, 2));
    }
    this.draw();
  }

  buildStage(flight, index) {
    const { label } = flight;
    const canvas3d = make("canvas", {
      class: "scene", tabindex: 0, role: "application",
      "aria-label": `${label} in three dimensions. Shift and arrow keys turn and tilt, brackets zoom. The tables below tell the same.`,
    });
    const canvas2d = make("canvas", { class: "map", role: "img", "aria-label": `${label} from above. The tables below tell the same.` });
    const labels = make("div", { class: "labels", "aria-hidden": "true" });
    const hint = make("div", { class: "hint", hidden: true, "aria-hidden": "true" });
    const camera = make("div", { class: "camera", role: "group", "aria-label": `Camera of ${label}` });
    for (const [how, steps, sign, name] of CAMERA_BUTTONS) {
      const button = make("button", { type: "button", "aria-label": name, title: name }, sign);
      button.addEventListener("click", () => this.moveCamera(how, steps));
      camera.append(button);
    }
    const box = make("div", { class: "stage" }, canvas2d, canvas3d, labels, camera, hint);
    const service = make("p", { class: "service" });
    byId("flights").append(
      make("section", { class: "flight", "aria-label": label },
        make("h2", {}, flightMark(index), make("bdi", {}, label)),
        flight.note && make("p", { class: "quiet note" }, flight.note), box, service),
    );
    const stage = { flight, box, canvas3d, labels, service, map: new Map2d(canvas2d, this.replay, flight), scene: null };
    this.showHints(stage, hint);
    return stage;
  }

  showHints(stage, hint) {
    stage.box.addEventListener("pointermove", (event) => {
      const box = stage.box.getBoundingClientRect();
      const [x, y] = [event.clientX - box.left, event.clientY - box.top];
      const found = event.buttons ? null : (this.is3d ? stage.scene : stage.map).pick(x, y);
      hint.hidden = !found;
      if (!found) return;
      setText(hint, this.describe(stage, found));
      const isRight = x > box.width / 2;
      hint.style.left = isRight ? "auto" : `${x + 14}px`;
      hint.style.right = isRight ? `${box.width - x + 14}px` : "auto";
      hint.style.top = `${Math.min(y + 10, box.height - 60)}px`;
    });
    stage.box.addEventListener("pointerleave", () => { hint.hidden = true; });
  }

  describe(stage, { kind, index }) {
    const { replay, player } = this;
    const moment = momentOf(replay, stage.flight, player.slot);
    if (kind === "drone") {
      const upM = numberText(moment.drones[3 * index + 2], 0);
      const powerW = moment.powersW[index];
      const people = moment.servers.filter((server) => server === index).length;
      const power = powerW > 0 ? `transmits ${numberText(powerW, 3)} W to ${people}` : "out of service";
      return `${stage.flight.drones.names[index]}: ${upM} m high, ${power}`;
    }
    const name = replay.people.names?.[index] || `Person ${index}`;
    const weight = replay.people.weights?.[index] ?? 1;
    const server = moment.servers[index];
    const many = weight > 1 ? ` (stands for ${weight})` : "";
    const rate = moment.rates[index] > 0 ? `, ${rateText(moment.rates[index])}` : "";
    return `${name}${many}: served by ${serverName(replay, stage.flight, server)}${rate}`;
  }
}

function hasWebgl() {
  const context = document.createElement("canvas").getContext("webgl2");
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return context !== null;
}
