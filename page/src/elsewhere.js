// Arms on other machines: one row each, as in `contactd fleet`, with its own stop button.

import { post } from "./commands.js";
import { at, make, say, show } from "./dom.js";
import { MODES } from "./words.js";

/** Id of the row of the arm elsewhere with this name. */
export const placeOf = (name) => `elsewhere-${name}`;

/** Text on the state of an arm elsewhere, as in its tab. */
export function stateOf(other) {
  if (other.silent || other.state !== "alive") return other.state;
  const [sign, word] = MODES[other.mode] ?? ["?", other.mode || "no State yet"];
  return `${sign} ${word}${other.armed ? ", armed" : ""}`;
}

/** Text on the outcomes of stops elsewhere, and its kind: bad unless every arm stands. */
export function outcomesOf(arms) {
  const names = Object.keys(arms);
  if (names.length === 0) return ["bad", "No arm is alive elsewhere."];
  const lines = names.map((name) => {
    const { outcome, text } = arms[name];
    return `${name}: ${outcome === "stands" ? "it stands" : outcome}${text && text !== outcome ? ` (${text})` : ""}`;
  });
  const good = names.every((name) => arms[name].outcome === "stands");
  return [good ? "good" : "bad", `${lines.join("; ")}.${good ? "" : " Use the emergency stop there."}`];
}

export class Elsewhere {
  #may = false; #rows = new Map(); #number = 0;

  constructor() {
    at("stop-elsewhere").addEventListener("click", () => this.#stop(""));
  }

  /** Allow commands, or not. */
  allow(may) {
    this.#may = may;
    show(at("stop-elsewhere"), may);
  }

  /** Draw all arms elsewhere. Rows never move, so that a click cannot hit another arm's row. */
  draw({ arms, why }) {
    show(at("elsewhere-section"), true);
    show(at("elsewhere"), arms.length > 0);
    if (arms.length === 0) this.#say("", why || "No arm is known there.");
    else if (["", "old"].includes(at("elsewhere-note").dataset.kind ?? "")) this.#say("", why);
    const body = at("elsewhere").tBodies[0];
    for (const other of arms) {
      if (!this.#rows.has(other.arm)) {
        this.#rows.set(other.arm, this.#row(other.arm));
        body.append(this.#rows.get(other.arm));
      }
      const row = this.#rows.get(other.arm);
      row.dataset.level = other.silent || other.state !== "alive" ? "SILENT" : other.level;
      const was = other.silent && other.mode ? `was ${other.mode}` : stateOf(other);
      [other.state, was, other.text, other.contact].forEach((text, i) => say(row.cells[i + 1], text));
      show(row.cells[5].firstChild, this.#may);
    }
  }

  /** Show that the rows are old, because the page's server is not reached. */
  old() {
    if (this.#rows.size === 0) return;
    this.#say("old", "What you see of arms elsewhere is old.");
    for (const row of this.#rows.values()) row.dataset.level = "SILENT";
  }

  #row(name) {
    const stop = make("button", { type: "button", "aria-label": `Stop ${name}` }, "STOP");
    stop.addEventListener("click", () => this.#stop(name));
    const cells = [1, 2, 3, 4].map(() => make("td"));
    return make("tr", { id: placeOf(name) }, make("th", { scope: "row" }, name), ...cells, make("td", {}, stop));
  }

  async #stop(name) {
    const number = ++this.#number;
    this.#say("waiting", `Stopping ${name || "all"}`);
    let said;
    try {
      const { arms } = await post(`elsewhere/stop?arm=${encodeURIComponent(name)}`, "stop");
      said = outcomesOf(arms);
    } catch (error) {
      said = ["bad", `NOT REACHED: use the emergency stop there. (${error.message})`];
    }
    if (number === this.#number) this.#say(...said);
  }

  #say(kind, text) {
    at("elsewhere-note").dataset.kind = kind;
    say(at("elsewhere-note"), text);
  }
}
