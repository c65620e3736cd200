/** The page of a replay. */

import { showSlot, wireControls } from "./controls.js";
import { buildCurves } from "./curves.js";
import { byId, setText } from "./dom.js";
import { Player } from "./player.js";
import { openReplay } from "./replay.js";
import { buildDroneTables, buildSummary } from "./tables.js";
import { Views } from "./views.js";

const WORDS_EVERY_MS = 200;
const TRAIL_S = 40;
/** Time between pictures, over several, from which on three dimensions are too slow to be of use. */
const SLOW_MS = 300;
const PICTURES = 10;
const CALM = matchMedia("(prefers-reduced-motion: reduce)");

async function start() {
  if (!("DecompressionStream" in globalThis)) {
    throw new Error("This browser is too old to unpack the flight: Chrome or Edge 80, Firefox 113 and Safari 16.4 can, and newer ones.");
  }
  const replay = await openReplay(JSON.parse(byId("document").textContent));
  showHeader(replay);
  const player = new Player(replay.slots, replay.slotS, () => CALM.matches);
  const state = {
    byRate: false,
    links: true,
    trails: true,
    trailSlots: Math.max(Math.round(TRAIL_S / replay.slotS), 1),
    highlight: -1,
    heights: Number(byId("heights").value),
  };
  byId("loading").remove();
  byId("page").hidden = false;
  const views = new Views(replay, player, state);
  const shows = [buildDroneTables(replay), buildSummary(replay)];
  const showCurves = buildCurves(replay, player);
  wireControls(replay, player, state, views);

  let lastWords = -Infinity;
  player.addEventListener("change", () => {
    views.draw();
    showCurves();
    showSlot(replay, player);
    if (player.isPlaying && performance.now() - lastWords < WORDS_EVERY_MS) return;
    lastWords = performance.now();
    views.tell();
    shows.forEach((show) => show(player.slot));
  });
  player.seek(slotOfAddress());
  addEventListener("hashchange", () => player.step(slotOfAddress() - player.slot));
  await views.start3d();
  if (views.has3d) {
    byId("view-3d").checked = true;
    views.choose(true);
  }
  noticeSlowness(player, views);
  document.documentElement.dataset.ready = views.has3d ? "3d" : "2d";
  if (!CALM.matches && !location.hash) player.play();
}

/** Without a graphics card the processor draws: then say which view is fast. */
function noticeSlowness(player, views) {
  let times = [];
  const watch = () => {
    times = player.isPlaying && views.is3d ? [...times, performance.now()] : [];
    if (times.length <= PICTURES) return;
    player.removeEventListener("change", watch);
    if (times[PICTURES] - times[0] > PICTURES * SLOW_MS) {
      views.notice("Three dimensions are slow in this browser, perhaps without a graphics card: the 2-D view shows the same.");
    }
  };
  player.addEventListener("change", watch);
}

function showHeader(replay) {
  document.title = `${replay.title} – ORCHID replay`;
  setText(byId("title"), replay.title);
  setText(byId("subtitle"), replay.subtitle);
  if (replay.place) {
    const { lat, lon } = replay.place;
    byId("place").hidden = false;
    setText(byId("place"), `The middle of the area lies at ${lat.toFixed(5)}°, ${lon.toFixed(5)}° (latitude, longitude).`);
  }
}

/** Where an address such as flight.html#slot=120 begins; such a page does not play by itself. */
function slotOfAddress() {
  return Number(/^#slot=(\d{1,9})$/.exec(location.hash)?.[1] ?? 0);
}

start().catch((problem) => {
  byId("loading")?.remove();
  byId("page").hidden = true;
  byId("problem").hidden = false;
  setText(byId("problem"), `This flight cannot be shown. ${problem.message}`);
});
