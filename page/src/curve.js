// Curve of one joint: 20 s of its residual between the levels in force, with modes and contacts as shading.

import uPlot from "uplot";
import { WINDOW_S } from "./series.js";

const GUIDED = new Set(["admittance", "retracting", "releasing"]);

/** Colours of the theme in force, from the style sheet. */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  return {
    residual: of("--residual"),
    level: of("--level"),
    grid: of("--line"),
    text: of("--dim"),
    contact: of("--contact-shade"),
    collision: of("--collision"),
    guided: of("--guided-shade"),
    stopped: of("--stopped-shade"),
  };
}

/** Columns of a joint's series: time, residual, +level, -level, mode, 1 contact or 2 collision. */
export const COLUMNS = 6;

export class Curve {
  #plot; #columns = null; #colours = colours(); #modes;

  constructor(host, modes) {
    this.#modes = modes;
    this.#plot = new uPlot(this.#options(host), [[], [], [], []], host);
    this.#resize = new ResizeObserver(() => {
      if (host.clientWidth > 0) this.#plot.setSize({ width: host.clientWidth, height: host.clientHeight });
    });
    this.#resize.observe(host);
  }
  #resize;

  /** Draw the columns of a window that ends at `end_s`. */
  draw(columns, end_s) {
    this.#columns = columns;
    const plot = this.#plot;
    plot.batch(() => {
      plot.setData(columns.slice(0, 4), false);
      plot.setScale("x", { min: end_s - WINDOW_S, max: end_s });
    });
  }

  /** Take the colours of another theme. */
  recolour() {
    this.#colours = colours();
    this.#plot.redraw();
  }

  destroy() {
    this.#resize.disconnect();
    this.#plot.destroy();
  }

  #options(host) {
    const line = (pick, dash) => ({
      stroke: () => this.#colours[pick],
      width: dash ? 1 : 1.5,
      dash,
      points: { show: false },
    });
    const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
    const axis = {
      stroke: () => this.#colours.text,
      grid: { stroke: () => this.#colours.grid, width: 1 },
      ticks: { show: false },
      font: `${0.72 * rem}px system-ui, sans-serif`,
    };
    return {
      width: host.clientWidth || 300,
      height: host.clientHeight || 96,
      legend: { show: false },
      cursor: { show: false },
      select: { show: false },
      padding: [6, 1.1 * rem, 0, 0],
      scales: { x: { time: false, auto: false }, y: { range: spread } },
      series: [{}, line("residual"), line("level", [4, 3]), line("level", [4, 3])],
      axes: [
        { ...axis, size: 1.2 * rem, gap: 2, splits: (u) => seconds(u), values: (u, at) => at.map((t) => ago(u, t)) },
        // Before the first tick there is no scale.
        { ...axis, size: 2.4 * rem, gap: 4, values: (u, at) => at.map((v) => (u.data[0].length ? String(v) : "")),
          space: (u, axis, low, high, height) => Math.max(1.1 * rem, height / 8) },
      ],
      hooks: { drawClear: [(u) => this.#shade(u)] },
    };
  }

  /** Paint the background of the curve: modes over the full height, contacts as a strip with a
      hatched edge, collisions as marks at the top. */
  #shade(u) {
    if (this.#columns === null) return;
    const [times, , , , mode, felt] = this.#columns;
    const { ctx } = u;
    const { top, height } = u.bbox;
    const of = { guided: (i) => this.#isGuided(mode[i]), stopped: (i) => this.#isStopped(mode[i]) };
    ctx.save();
    for (const [name, holds] of Object.entries(of)) {
      ctx.fillStyle = this.#colours[name];
      spans(u, times, holds, (x, width) => ctx.fillRect(x, top, width, height));
    }
    ctx.fillStyle = this.#colours.contact;
    spans(u, times, (i) => felt[i] >= 1, (x, width) => ctx.fillRect(x, top, width, height));
    ctx.fillStyle = this.#colours.collision;
    const size = 5 * devicePixelRatio;
    spans(u, times, (i) => felt[i] >= 2, (x) => {
      ctx.beginPath();
      ctx.moveTo(x - size, top);
      ctx.lineTo(x + size, top);
      ctx.lineTo(x, top + 2 * size);
      ctx.fill();
    });
    ctx.restore();
  }

  #isGuided(mode) {
    return GUIDED.has(this.#modes[mode]);
  }

  #isStopped(mode) {
    return this.#modes[mode] === "faulted" || this.#modes[mode] === "stopping";
  }
}

/** Range of the ordinate: residual and levels, with some margin. */
function spread(u, low, high) {
  const reach = 1.15 * Math.max(Math.abs(low ?? 0), Math.abs(high ?? 0), 1e-3);
  return [-reach, reach];
}

function seconds(u) {
  const end = u.scales.x.max;
  return [20, 15, 10, 5, 0].map((s) => end - s);
}

function ago(u, time) {
  const s = Math.round(u.scales.x.max - time);
  return s === 0 ? "latest" : `-${s} s`;
}

/** Call `paint(x, width)` for each run of samples that satisfies `holds`. */
function spans(u, times, holds, paint) {
  let begin = -1;
  for (let i = 0; i <= times.length; i++) {
    const on = i < times.length && holds(i);
    if (on && begin < 0) begin = i;
    if (!on && begin >= 0) {
      const from = u.valToPos(times[begin], "x", true);
      const to = u.valToPos(times[Math.min(i, times.length - 1)], "x", true);
      paint(from, Math.max(to - from, devicePixelRatio));
      begin = -1;
    }
  }
}
