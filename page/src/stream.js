// Stream of one arm's States: a WebSocket that reconnects by itself, and the age of what arrived.

import { framesOf } from "./frames.js";

export const STALE_MS = 1000;
const RETRY_MS = 500;
const SILENT_MS = 3000; // an open connection without a message for this long is given up
const CLOCK_EVERY_MS = 3000;
const READINGS = 20; // of the daemon's clock that are kept: a minute, in which the drift of two clocks is negligible

/**
 * Age of figures stamped with the time of the daemon's monotonic clock. That clock is requested apart from
 * the stream, and is read after the request was sent. So the age is never less than the true one, however
 * long the figures were delayed, and from the first figure on.
 */
export class AgeClock {
  #offsets = []; // our clock less the daemon's [ms], each no more than the true one
  #newest_s = -Infinity;

  /** Start again: another daemon may have another clock. */
  reset() {
    this.#offsets = [];
    this.#newest_s = -Infinity;
  }

  /** Note that the daemon's clock was `monotonic_s` at some time after `asked_ms` of ours. */
  read(monotonic_s, asked_ms) {
    this.#offsets.push(asked_ms - 1e3 * monotonic_s);
    if (this.#offsets.length > READINGS) this.#offsets.shift();
  }

  /** Note figures stamped `monotonic_s`. */
  arrived(monotonic_s) {
    this.#newest_s = Math.max(this.#newest_s, monotonic_s);
  }

  /** True if the daemon's clock is known. */
  get known() {
    return this.#offsets.length > 0;
  }

  /** Age of the newest figures [ms]; infinite if unknown, as for figures stamped in the future: then one
      of the clocks was set, or was suspended. */
  age_ms(now_ms) {
    const age_ms = now_ms - 1e3 * this.#newest_s - Math.max(...this.#offsets);
    return age_ms > -STALE_MS ? age_ms : Infinity;
  }
}

/**
 * Calls `on.frame(frame)`, `on.message(object)`, `on.problem(text)`, and `on.lost()` if the server is lost.
 */
export class Stream {
  #url; #on; #socket = null; #heard_ms = 0; #framed_ms = -Infinity; #retry = null; #asking = false;
  clock = new AgeClock();

  constructor(url, on) {
    this.#url = url;
    this.#on = on;
    this.#connect();
    setInterval(() => this.#watch(), 250);
    setInterval(() => this.#askClock(), CLOCK_EVERY_MS);
  }

  /** Age of the figures shown [ms]. */
  get age_ms() {
    return this.clock.age_ms(performance.now());
  }

  /** True if figures arrived within STALE_MS, however old they are. */
  get flows() {
    return this.clock.known && performance.now() - this.#framed_ms < STALE_MS;
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
      if (message.kind === "hello") {
        this.clock.reset();
        this.#askClock();
      }
      this.#on.message(message);
      return;
    }
    try {
      for (const frame of framesOf(data)) {
        if (!frame.past) {
          this.#framed_ms = performance.now();
          this.clock.arrived(frame.monotonic_s);
        }
        this.#on.frame(frame);
      }
    } catch (error) {
      this.#on.problem(error.message);
    }
  }

  async #askClock() {
    if (this.#asking) return;
    this.#asking = true;
    try {
      const asked_ms = performance.now();
      const response = await fetch("clock", { cache: "no-store", signal: AbortSignal.timeout(STALE_MS) });
      if (response.ok) this.clock.read(Number(await response.text()), asked_ms);
    } catch {
      // Without an answer the age stays unknown, or is computed from earlier readings.
    }
    this.#asking = false;
  }

  #again(socket, why) {
    if (socket !== this.#socket || this.#retry !== null) return;
    this.#on.problem(why);
    this.#on.lost();
    this.#socket = null;
    this.#retry = setTimeout(() => this.#connect(), RETRY_MS);
  }

  /** Give up a connection that is open but silent; its close may never be reported. */
  #watch() {
    const socket = this.#socket;
    if (socket === null || performance.now() - this.#heard_ms < SILENT_MS) return;
    socket.onclose = socket.onmessage = null;
    socket.close();
    this.#again(socket, "the page's server is silent");
  }
}
