// The footer: the daemon's time, lateness and work of its loop, load of the bus, ticks lost in transit.

import { at, make, say } from "./dom.js";
import { clock, duration } from "./words.js";

const WINDOW = 1000; // ticks

export class Loop {
  #late = new Float64Array(WINDOW); #work = new Float64Array(WINDOW); #count = 0;
  #last = -1; #lost = 0; #hello = null; #rows = new Map();

  begin(hello) {
    this.#hello = hello;
    this.#last = -1;
    this.#count = 0;
  }

  /** Take a tick, and count the ticks that are missing before it. */
  add(tick) {
    if (this.#last >= 0 && tick.tick > this.#last + 1) this.#lost += tick.tick - this.#last - 1;
    this.#last = tick.tick;
    this.#late[this.#count % WINDOW] = tick.lateness_s;
    this.#work[this.#count % WINDOW] = tick.work_s;
    this.#count += 1;
  }

  draw(tick, frame, age_ms) {
    const n = Math.min(this.#count, WINDOW);
    const late = this.#late.slice(0, n).sort();
    const work = this.#work.slice(0, n).sort();
    const ms = (s) => (1e3 * s).toFixed(2);
    const { period_s, bus_load, program } = this.#hello;
    this.#row("daemon's time", `${clock(frame.wall_s)}, up ${duration(tick.time_s)}`);
    this.#row("tick", String(tick.tick));
    this.#row("wake-up late by", `${ms(late[n >> 1])} ms, at most ${ms(late[n - 1])} ms`);
    this.#row("work", `at most ${ms(work[n - 1])} of ${(1e3 * period_s).toFixed(0)} ms`);
    this.#row("deadlines missed", String(frame.missed));
    this.#row("bus load", bus_load === null ? "unknown" : `${(100 * bus_load).toFixed(0)} % at worst`);
    this.#row("ticks lost in transit", String(this.#lost));
    this.age(age_ms);
    this.#row("program", program);
  }

  /** Show how old the picture is [ms]. */
  age(age_ms) {
    if (this.#last < 0) return;
    this.#row("picture", Number.isFinite(age_ms) ? `${ageInWords(age_ms)} old` : "of unknown age");
  }

  #row(name, text) {
    if (!this.#rows.has(name)) {
      const value = make("dd");
      at("loop").append(make("div", {}, make("dt", {}, name), value));
      this.#rows.set(name, value);
    }
    say(this.#rows.get(name), text);
  }
}

function ageInWords(age_ms) {
  return age_ms < 1000 ? `${Math.max(age_ms, 0).toFixed(0)} ms` : duration(age_ms / 1e3);
}
