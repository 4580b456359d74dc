// Stream of one arm's States: a WebSocket that connects again by itself, and the age of what it brought.

import { framesOf } from "./frames.js";

export const STALE_MS = 1000;
const RETRY_MS = 500;
const SILENT_MS = 3000; // an open connection that brings nothing is given up

/**
 * Age of figures that arrive with the daemon's own monotonic clock. The quickest arrival of a
 * connection is taken for immediate; what comes later than that is as old as it is late. So figures
 * that were held up on their way are never taken for live.
 */
export class AgeClock {
  #offset = Infinity;
  #newest = -Infinity; // arrival of the newest figures, as if they had come at once

  /** Begin anew: another daemon has another clock. */
  reset() {
    this.#offset = Infinity;
    this.#newest = -Infinity;
  }

  /** Take note of figures from `monotonic_s` that arrived at `now_ms`. */
  arrived(monotonic_s, now_ms) {
    this.#offset = Math.min(this.#offset, now_ms - 1e3 * monotonic_s);
    this.#newest = Math.max(this.#newest, 1e3 * monotonic_s + this.#offset);
  }

  /** Age of the newest figures [ms]; infinite before the first. */
  age_ms(now_ms) {
    return now_ms - this.#newest;
  }
}

/**
 * Calls `on.frame(frame)`, `on.message(object)` and `on.problem(text)`; `now` returns milliseconds.
 */
export class Stream {
  #url; #on; #socket = null; #heard_ms = 0; #retry = null;
  clock = new AgeClock();

  constructor(url, on) {
    this.#url = url;
    this.#on = on;
    this.#connect();
    setInterval(() => this.#watch(), 250);
  }

  /** Age of what is shown [ms]. */
  get age_ms() {
    return this.clock.age_ms(performance.now());
  }

  #connect() {
    this.#retry = null;
    this.#heard_ms = performance.now();
    const socket = new WebSocket(this.#url);
    this.#socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.#take(socket, event.data);
    socket.onclose = () => this.#again(socket, "the page's server is not reached");
  }

  #take(socket, data) {
    if (socket !== this.#socket) return;
    this.#heard_ms = performance.now();
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.kind === "hello") this.clock.reset();
      this.#on.message(message);
      return;
    }
    try {
      for (const frame of framesOf(data)) {
        if (!frame.past) this.clock.arrived(frame.monotonic_s, performance.now());
        this.#on.frame(frame);
      }
    } catch (error) {
      this.#on.problem(error.message);
    }
  }

  #again(socket, why) {
    if (socket !== this.#socket || this.#retry !== null) return;
    this.#on.problem(why);
    this.#socket = null;
    this.#retry = setTimeout(() => this.#connect(), RETRY_MS);
  }

  /** Give up a connection that is open and silent; its end may never be told. */
  #watch() {
    const socket = this.#socket;
    if (socket === null || performance.now() - this.#heard_ms < SILENT_MS) return;
    socket.onclose = socket.onmessage = null;
    socket.close();
    this.#again(socket, "the page's server is silent");
  }
}
