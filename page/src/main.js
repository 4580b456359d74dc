// The page of one arm: takes its stream and has the other modules draw it.

import { drawArming, sayArming } from "./arming.js";
import { Commands } from "./commands.js";
import { at, say, show } from "./dom.js";
import { Elsewhere } from "./elsewhere.js";
import { Events } from "./events.js";
import { Header, drawTabs } from "./header.js";
import { Joints } from "./joints.js";
import { Loop } from "./loop.js";
import { RecordingsPanel } from "./recordings.js";
import { STALE_MS, Stream } from "./stream.js";

const CURVES_EVERY_MS = 66;
const CORNER_EVERY_MS = 500;
const STANDS = new Set(["off", "holding", "faulted"]);

const arm = Number(new URLSearchParams(location.search).get("arm") ?? 0);
const header = new Header();
const joints = new Joints(at("joints"));
const events = new Events();
const loop = new Loop();
const commands = new Commands(arm);
const recordings = new RecordingsPanel(arm);
const elsewhere = new Elsewhere();

let hello = null, summary = null, others = [], advice = null, said = null, armed = false, scene = null;
let newest = null; // {tick, frame}: the newest live one
let drawn = null, curves_ms = 0, corner_ms = 0, why = "", gone = false, stale = true;

const url = new URL(`live/${arm}`, location.href);
url.protocol = url.protocol.replace("http", "ws");
const stream = new Stream(url, { frame: takeFrame, message: takeMessage, problem: lose, lost });

function takeMessage(message) {
  switch (message.kind) {
    case "hello": return begin(message);
    case "words": return takeWords(message);
    case "advice":
      header.advice(message);
      advice = message;
      drawArming(advice, armed, stale);
      return joints.learned(message.learned);
    case "summary":
      if (JSON.stringify(summary) === JSON.stringify(message)) return undefined; // a sign of life
      summary = message;
      return drawTabs(hello?.arms ?? [], arm, summary, others);
    case "elsewhere":
      others = message.arms;
      elsewhere.draw(message);
      return drawTabs(hello?.arms ?? [], arm, summary, others);
    case "events": return events.take(message);
    case "gone":
      return lose(message.why);
    default: return undefined; // from a newer server
  }
}

/** An arm known to be gone is stale at once; a silent one, after STALE_MS. */
function lose(text) {
  why = text;
  gone = true;
}

/** Without the server the state of every arm is unknown. */
function lost() {
  elsewhere.old();
  summary = null;
  others = others.map((other) => ({ ...other, silent: true, state: "not live" }));
  drawTabs(hello?.arms ?? [], arm, summary, others);
}

const isOld = () => gone || stream.age_ms > STALE_MS;

/** Start with an arm, or continue with it: what was last drawn stays if the same arm reconnects. */
function begin(message) {
  const same = JSON.stringify(message) === JSON.stringify(hello);
  hello = message;
  why = "";
  gone = hello.joints.length === 0;
  say(at("name"), hello.arms[arm] ?? "no such arm");
  drawTabs(hello.arms, arm, summary, others);
  commands.allow(hello.may_command);
  recordings.allow(hello.may_record);
  elsewhere.allow(hello.may_command);
  if (hello.joints.length === 0) return;
  loop.begin(hello);
  if (same) return;
  newest = drawn = null;
  header.begin(hello);
  joints.begin(hello);
  scene?.begin(hello);
  show(at("shapes"), scene !== null && Boolean(hello.walls));
}

function takeWords(words) {
  armed = words.armed;
  if (advice !== null) sayArming(advice.checks, armed, stale);
  said = words;
  header.words(words);
  joints.words(words);
  scene?.words(words);
  show(at("meeting"), Boolean(words.meeting));
  say(at("meeting"), words.meeting ? `✖ Refused: ${words.meeting.text}.` : "");
  commands.seen(STANDS.has(words.mode) && words.unproved.length === 0, words.mode);
}

function takeFrame(frame) {
  if (hello === null || hello.joints.length === 0) return;
  for (const tick of frame.ticks) {
    joints.add(tick);
    if (!frame.past) loop.add(tick);
  }
  if (!frame.past) newest = { tick: frame.ticks.at(-1), frame };
}

/** Tell every part whether it is live; a part that is not is shown as past. */
function updateAge(age_ms) {
  const was = stale;
  stale = isOld();
  header.age(age_ms, stale, why, !gone && stream.flows);
  if (stale) loop.age(age_ms);
  if (stale === was) return;
  joints.age(stale);
  if (advice !== null) sayArming(advice.checks, armed, stale);
}

function draw(now) {
  requestAnimationFrame(draw);
  const age_ms = stream.age_ms;
  updateAge(age_ms);
  // The last tick is drawn even if it is old: in grey, beside the texts of the same tick.
  if (newest === null || newest === drawn) return;
  drawn = newest;
  const { tick, frame } = newest;
  header.tick(tick, frame);
  const curves = now - curves_ms >= CURVES_EVERY_MS;
  if (curves) curves_ms = now;
  joints.draw(tick, curves);
  scene?.draw(tick);
  if (now - corner_ms >= CORNER_EVERY_MS) {
    corner_ms = now;
    loop.draw(tick, frame, age_ms);
  }
  if (!stale && performance.getEntriesByName("live").length === 0) performance.mark("live");
  document.documentElement.dataset.tick = tick.tick;
}
requestAnimationFrame(draw);
// A page in the background draws nothing, but its texts must still be marked as old.
setInterval(() => updateAge(stream.age_ms), 200);

// --- the arm in three dimensions: only if there is WebGL, and loaded last ---------------------------

function webgl(careful) {
  const options = { failIfMajorPerformanceCaveat: careful };
  return document.createElement("canvas").getContext("webgl2", options) !== null;
}

async function openScene() {
  show(at("scene-toggle"), false);
  try {
    const { Scene } = await import("./scene.js");
    scene = new Scene(at("scene"), `arms/${arm}/urdf`, (text) => say(at("scene-note"), text));
    if (hello?.joints.length) await scene.begin(hello);
    show(at("shapes"), Boolean(hello?.walls));
    at("shapes").addEventListener("change", ({ target }) => scene.show(target.checked));
    if (said !== null) scene.words(said);
  } catch (error) {
    say(at("scene-note"), `The arm cannot be drawn: ${error.message}.`);
  }
}

const asked = new URLSearchParams(location.search).get("scene");
if (asked === "off" || !webgl(false)) {
  show(at("scene"), false);
  say(at("scene-note"), asked === "off" ? "Switched off." : "This browser cannot draw in three dimensions (no WebGL).");
} else if (asked === "on" || webgl(true)) {
  requestIdleCallback?.(openScene) ?? setTimeout(openScene, 200);
} else {
  say(at("scene-note"), "This computer would draw the arm slowly, without a graphics processor.");
  say(at("scene-toggle"), "Draw it anyway");
  show(at("scene-toggle"), true);
  at("scene-toggle").addEventListener("click", () => {
    say(at("scene-note"), "");
    openScene();
  });
}
