// Event log: newest first, with a filter by kind and text; bounded.

import { at, make } from "./dom.js";
import { clock } from "./words.js";

const MOST = 500;
const SIGNS = { mode: "▸", contact: "▲", fault: "✖", page: "◦" };

export class Events {
  #events = []; #list = at("events"); #form = at("filter");

  constructor() {
    this.#form.addEventListener("input", () => this.#draw());
    this.#form.addEventListener("submit", (event) => event.preventDefault());
  }

  /** Add new events; with `past`, replace all by the log so far. */
  take({ events, past }) {
    this.#events = (past ? [] : this.#events).concat(events).slice(-MOST);
    this.#draw();
  }

  #draw() {
    const wanted = new FormData(this.#form);
    const text = wanted.get("text").trim().toLowerCase();
    const shown = this.#events.filter(
      (event) => (event.kind === "page" || wanted.has(event.kind)) && event.text.toLowerCase().includes(text),
    );
    const lines = shown.reverse().map((event) =>
      make("li", { "data-kind": event.kind },
        make("time", {}, clock(event.wall_s, 2)),
        make("span", { class: "kind" }, `${SIGNS[event.kind] ?? "◦"} ${event.kind}`),
        make("span", {}, event.text)));
    const none = make("li", { class: "none" }, this.#events.length ? "No event passes the filter." : "Nothing has happened yet.");
    this.#list.replaceChildren(...(lines.length ? lines : [none]));
  }
}
