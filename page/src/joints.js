// One card for each joint: residual relative to its level, curve, gap, sensing, drive, what was learned.

import { COLUMNS, Curve } from "./curve.js";
import { make, say, show } from "./dom.js";
import { Series } from "./series.js";
import { SIDES, fixed, isBeyond, learned, signed } from "./words.js";

const METERS_EVERY_MS = 1000; // for screen readers
/** Names of the operating state of each make of drive (`OPERATING` in programs/clients/shown.py). */
const OPERATING = new Set(["operation enabled", "enabled", "running"]);

/** All cards. `draw` takes the newest tick, `add` every tick. */
export class Joints {
  #host; #cards = []; #modes = []; #stale = true;

  constructor(host) {
    this.#host = host;
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      for (const card of this.#cards) card.curve.recolour();
    });
  }

  /** Make cards for these joints. */
  begin(hello) {
    for (const card of this.#cards) card.curve.destroy();
    this.#modes = hello.modes;
    this.#cards = hello.joints.map((name, i) => new Card(name, i, hello));
    this.#host.replaceChildren(...this.#cards.map((card) => card.element));
    for (const card of this.#cards) {
      card.place();
      card.age(this.#stale);
    }
  }

  add(tick) {
    for (const card of this.#cards) card.add(tick);
  }

  /** Draw the bars, and the curves if `curves`. */
  draw(tick, curves) {
    for (const card of this.#cards) card.draw(tick, curves);
  }

  words(words) {
    this.#cards.forEach((card, i) => card.words(words, words.drives[i] ?? ""));
  }

  /** Mark all cards as showing past (stale) or present values. */
  age(stale) {
    this.#stale = stale;
    for (const card of this.#cards) card.age(stale);
  }

  learned(found) {
    this.#cards.forEach((card, i) => card.learned(learned(found, i)));
  }
}

class Card {
  #index; #half_gap; #name; #series = new Series(COLUMNS); #host; #modes; #told_ms = 0; #drive = "";
  #energised = false; #parts; #tick = null; #stale = true;

  constructor(name, index, hello) {
    this.#name = name;
    this.#index = index;
    this.#half_gap = hello.half_gap[index];
    this.#modes = hello.modes;
    const part = (kind, ...children) => make("span", { class: kind }, ...children);
    this.#parts = {
      state: part("state"),
      torque: part("torque"),
      fill: part("fill"),
      low: part("mark low"),
      high: part("mark high"),
      sigma: part("sigma"),
      marker: part("marker"),
      side: part("side"),
      learned: make("p", { class: "learned", hidden: true }),
    };
    const p = this.#parts;
    this.bar = make("span", {
      class: "bar", role: "meter", "aria-label": `Residual torque of ${name} in Nm`,
      "aria-valuemin": "-2", "aria-valuemax": "2", "aria-valuenow": "0",
    }, p.fill, p.low, p.high, part("middle"));
    this.gap = make("span", { class: "gap" }, part("track"), p.sigma, p.marker);
    this.#host = make("div", { class: "curve" });
    const gapRow = this.#half_gap > 0
      ? make("p", { class: "gaprow" }, "gap ", this.gap, " ", p.side)
      : make("p", { class: "gaprow" }, "no gap");
    this.element = make("article", { class: "joint", "aria-label": name },
      make("h3", {}, name, " ", p.state),
      make("p", { class: "barrow" }, this.bar, p.torque),
      this.#host, gapRow, p.learned);
  }

  /** Make the curve, once the card is in the document and has a width. */
  place() {
    this.curve = new Curve(this.#host, this.#modes);
  }

  add(tick) {
    const i = this.#index;
    const level = tick.threshold[i];
    const flags = tick.joints[i];
    const felt = flags.collision ? 2 : isBeyond(tick, i) ? 1 : 0;
    this.#series.add([tick.time_s, tick.residual[i], level, -level, tick.mode, felt]);
  }

  draw(tick, curves) {
    const i = this.#index;
    const [residual, level, flags] = [tick.residual[i], tick.threshold[i], tick.joints[i]];
    const beyond = isBeyond(tick, i);
    this.#tick = tick;
    // The bar ends at twice the level.
    const share = level > 0 ? Math.max(-1, Math.min(1, residual / (2 * level))) : 0;
    const p = this.#parts;
    p.fill.style.left = `${50 + 50 * Math.min(share, 0)}%`;
    p.fill.style.width = `${50 * Math.abs(share)}%`;
    this.element.classList.toggle("beyond", beyond);
    this.element.classList.toggle("touched", flags.touched);
    this.#drawGap(tick.phi[i], tick.phi_sigma[i], flags.side);
    this.#drawWords();
    if (curves) this.curve.draw(this.#series.window(tick.time_s), tick.time_s);
    const now = performance.now();
    if (now - this.#told_ms > METERS_EVERY_MS) {
      this.#told_ms = now;
      const reach = (2 * level).toFixed(2);
      this.bar.setAttribute("aria-valuemin", -reach);
      this.bar.setAttribute("aria-valuemax", reach);
      this.bar.setAttribute("aria-valuenow", residual.toFixed(2));
      this.#drawMeter();
    }
  }

  /** Mark the card as showing past (stale) or present values. */
  age(stale) {
    this.#stale = stale;
    if (this.#tick === null) return;
    this.#drawWords();
    this.#drawMeter();
  }

  words(words, drive) {
    this.#drive = drive;
    this.#energised = words.mode !== "off" && words.mode !== "enabling";
  }

  learned(text) {
    show(this.#parts.learned, text !== "");
    say(this.#parts.learned, text);
  }

  #drawGap(phi, sigma, side) {
    if (this.#half_gap <= 0) return;
    const p = this.#parts;
    // The track is the gap; a quarter of the width is left on either side for angles outside it.
    const at = (angle) => 50 + 25 * Math.max(-2, Math.min(2, angle / this.#half_gap));
    const [from, to] = [at(phi - sigma), at(phi + sigma)];
    p.sigma.style.left = `${from}%`;
    p.sigma.style.width = `${to - from}%`;
    p.marker.style.left = `${at(phi)}%`;
    p.marker.dataset.side = side;
    const mrad = (angle) => fixed(1e3 * angle, 1);
    say(p.side, `${SIDES[side]} (${mrad(phi)} ± ${mrad(sigma)} mrad)`);
  }

  #drawMeter() {
    const [residual, level] = [this.#tick.residual[this.#index], this.#tick.threshold[this.#index]];
    this.bar.setAttribute("aria-valuetext", `${this.#was}${residual.toFixed(2)} of ${level.toFixed(2)}`);
  }

  /** Prefix of a torque that is not a present one. */
  get #was() {
    const flags = this.#tick.joints[this.#index];
    return !this.#stale && (flags.sensing || flags.fresh) ? "" : "was ";
  }

  #drawWords() {
    const [tick, i] = [this.#tick, this.#index];
    const beyond = isBeyond(tick, i);
    const mark = beyond ? " ▲" : "";
    say(this.#parts.torque, `${this.#was}${signed(tick.residual[i])} of ${tick.threshold[i].toFixed(2)} Nm${mark}`);
    this.#drawState(tick.joints[i], beyond);
  }

  #drawState(flags, beyond) {
    const parts = [];
    if (flags.unproved) parts.push("✖ not seen to stand");
    if (!flags.sensing) parts.push("✖ not sensing");
    if (!flags.fresh) parts.push("◌ sample missing");
    if (this.#energised && !OPERATING.has(this.#drive)) parts.push(`✖ ${this.#drive}`);
    if (beyond) parts.push("▲ contact");
    if (flags.touched) parts.push("◉ touched");
    const bad = parts.some((text) => text.startsWith("✖"));
    const state = this.#parts.state;
    state.dataset.kind = bad ? "bad" : beyond || flags.touched ? "felt" : "";
    if (parts.length === 0 && this.#energised) say(state, this.#stale ? "◌ was sensing" : "✓ sensing");
    else say(state, `${this.#stale ? "then: " : ""}${parts.join(" · ") || this.#drive}`);
  }
}
