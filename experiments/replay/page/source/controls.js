/** Buttons, slider, choices and keys, all of which move the player or change what is shown. */

import { byId, setText } from "./dom.js";
import { rateBounds, readLook } from "./look.js";
import { showLegend } from "./legend.js";
import { SPEEDS } from "./player.js";
import { slotSentences, slotText } from "./tables.js";
import { clockText } from "./text.js";

const SILENCE_MS = 700;
const DARK = matchMedia("(prefers-color-scheme: dark)");
/** Elements that have a use of their own for keys. */
const OWN_KEYS = "select, textarea, summary, .wide, input:not([type=range]):not([type=radio]):not([type=checkbox])";
const OWN_SPACE = "button, a, summary, select, input:not([type=range])";

/**
 * Wire everything that people act upon.
 *
 * @param {object} replay
 * @param {import("./player.js").Player} player
 * @param {object} state see `views.js`
 * @param {import("./views.js").Views} views
 */
export function wireControls(replay, player, state, views) {
  wirePlayer(replay, player);
  wireChoices(replay, player, state, views);
  wireKeys(player, views);
  wireHelp();
}

/**
 * Show the player's slot on the controls; said aloud only where it rests.
 *
 * @param {object} replay
 * @param {import("./player.js").Player} player
 */
export function showSlot(replay, player) {
  const slider = byId("time");
  const text = slotText(replay, player.slot);
  slider.value = String(player.slot);
  slider.setAttribute("aria-valuetext", text);
  setText(byId("slot"), `${player.slot} / ${replay.slots}`);
  setText(byId("clock"), `${clockText(player.slot * replay.slotS)} of ${clockText(replay.slots * replay.slotS)}`);
  clearTimeout(showSlot.waiting);
  if (!player.isPlaying) {
    showSlot.waiting = setTimeout(() => setText(byId("spoken"), slotSentences(replay, player.slot)), SILENCE_MS);
  }
}

function wirePlayer(replay, player) {
  const slider = byId("time");
  slider.max = String(replay.slots);
  slider.addEventListener("input", () => {
    player.pause();
    player.seek(Number(slider.value));
  });
  const speed = byId("speed");
  for (const one of SPEEDS) speed.append(new Option(`${one}×`, String(one)));
  speed.addEventListener("change", () => player.setSpeed(Number(speed.value)));
  const acts = {
    "to-start": () => player.step(-replay.slots),
    back: () => player.step(-1),
    play: () => player.toggle(),
    forward: () => player.step(1),
    "to-end": () => player.step(replay.slots),
  };
  for (const [id, act] of Object.entries(acts)) byId(id).addEventListener("click", act);
  const show = () => {
    speed.value = String(player.speed);
    document.body.classList.toggle("is-playing", player.isPlaying);
    byId("play").setAttribute("aria-label", player.isPlaying ? "Pause" : "Play");
  };
  player.addEventListener("state", show);
  show();
}

function wireChoices(replay, player, state, views) {
  const redraw = () => views.draw();
  const bounds = rateBounds(replay);
  const theme = byId("theme");
  const paint = () => {
    const isDark = theme.value === "dark" || (theme.value === "" && DARK.matches);
    document.documentElement.dataset.theme = isDark ? "dark" : "light";
    state.look = readLook(bounds);
    showLegend(replay, state.look, state.byRate);
    redraw();
  };
  theme.addEventListener("change", paint);
  DARK.addEventListener("change", paint);
  byId("by-rate").addEventListener("change", () => {
    state.byRate = byId("by-rate").value === "rate";
    paint();
  });
  for (const name of ["links", "trails"]) {
    byId(name).addEventListener("change", () => {
      state[name] = byId(name).checked;
      redraw();
    });
  }
  byId("heights").addEventListener("change", () => {
    state.heights = Number(byId("heights").value);
    redraw();
  });
  const names = replay.flights.reduce((longest, { drones }) => (drones.names.length > longest.length ? drones.names : longest), []);
  names.forEach((name, index) => byId("highlight").append(new Option(name, String(index))));
  byId("highlight").addEventListener("change", () => {
    state.highlight = Number(byId("highlight").value);
    redraw();
  });
  for (const [id, is3d] of [["view-2d", false], ["view-3d", true]]) {
    byId(id).addEventListener("change", () => views.choose(is3d));
  }
  paint();
}

function wireKeys(player, views) {
  const chooseView = (id) => {
    if (!byId(id).disabled) byId(id).click();
  };
  const acts = {
    " ": () => player.toggle(),
    ArrowLeft: () => player.step(-1),
    ArrowRight: () => player.step(1),
    Home: () => player.step(-player.slots),
    End: () => player.step(player.slots),
    "+": () => player.changeSpeed(1),
    "=": () => player.changeSpeed(1),
    "-": () => player.changeSpeed(-1),
    2: () => chooseView("view-2d"),
    3: () => chooseView("view-3d"),
    "[": () => views.moveCamera("zoom", -1),
    "]": () => views.moveCamera("zoom", 1),
    0: () => views.moveCamera("reset", 0),
    "?": () => byId("help").showModal(),
  };
  const shifted = {
    ArrowLeft: () => views.moveCamera("turn", 1),
    ArrowRight: () => views.moveCamera("turn", -1),
    ArrowUp: () => views.moveCamera("tilt", 1),
    ArrowDown: () => views.moveCamera("tilt", -1),
  };
  // First of all, since a slider and radio buttons would use arrows as well.
  document.addEventListener("keydown", (event) => {
    const { key, target } = event;
    if (event.ctrlKey || event.altKey || event.metaKey || byId("help").open) return;
    if (key.length === 1 && key !== " " && !byId("single-keys").checked) return;
    if (target.closest(key === " " ? OWN_SPACE : OWN_KEYS)) return;
    if (target.type === "radio" && key.startsWith("Arrow")) return;
    const act = event.shiftKey ? shifted[key] ?? (key.length === 1 && acts[key]) : acts[key];
    if (!act) return;
    event.preventDefault();
    act();
  });
}

function wireHelp() {
  byId("help-button").addEventListener("click", () => byId("help").showModal());
}
