// The header, which stays visible: mode and cause, permission with its countdown, fault, connection, tabs.

import { at, make, say, sayLinked, show } from "./dom.js";
import { placeOf, stateOf } from "./elsewhere.js";
import { MODES, clock, notSensing, duration, felt, next } from "./words.js";

export class Header {
  #words = null; #advice = null; #left_s = NaN; #wall_s = NaN; #stale = true; #tick = null; #joints = [];
  #quiet_s = 0;

  /** Start with an arm that has these joints, and goes on after quiet_s without contact. */
  begin({ joints, quiet_s }) {
    this.#joints = joints;
    this.#quiet_s = quiet_s;
    this.#tick = null;
  }

  /** Take the texts of the arm's last State. */
  words(words) {
    this.#words = words;
    this.#draw();
  }

  /** Take the daemon's answer to the status request: its advice on what to do. */
  advice(advice) {
    this.#advice = advice;
    document.title = advice.name;
    say(at("name"), advice.name);
    this.#drawStream();
    this.#draw();
  }

  /** Take the newest tick and its frame. */
  tick(tick, { left_s, wall_s }) {
    this.#tick = tick;
    this.#left_s = left_s;
    this.#wall_s = wall_s;
    this.#drawPermit();
    this.#drawNow();
  }

  /** Show whether the figures are live, and how old they are otherwise [ms]; slow: they still arrive. */
  age(age_ms, stale, why, slow) {
    const changed = stale !== this.#stale;
    this.#stale = stale;
    if (changed) {
      document.body.classList.toggle("stale", stale);
      this.#draw();
      this.#drawNow();
    }
    show(at("connection"), stale);
    if (!stale) return;
    const since = Number.isFinite(age_ms) ? ` for ${duration(age_ms / 1e3)}` : "";
    const old = this.#words ? " What you see is old." : "";
    const late = `The connection is too slow. What you see was${since.replace(" for", "")} ago.`;
    const none = `No connection${since}.${old} ${why ? `${sentence(why)} ` : ""}Reconnecting.`;
    say(at("connection"), slow ? late : none);
  }

  #draw() {
    const words = this.#words;
    if (words === null) return;
    const [sign, name, meaning] = MODES[words.mode] ?? ["?", words.mode, ""];
    const mode = at("mode");
    mode.dataset.mode = this.#stale ? "old" : words.mode;
    say(mode, this.#stale ? `was ${name}` : `${sign} ${name}`);
    mode.title = meaning;
    show(at("cause"), words.mode !== "faulted"); // the banner shows it
    say(at("cause"), `${this.#stale ? "Cause then" : "Cause"}: ${words.cause}`);
    this.#drawPermit();
    this.#drawLoad(words.load);
    this.#drawStream();
    show(at("guide"), Boolean(words.guide));
    say(at("guide"), `${this.#stale ? "Then: guide" : "Guide"} for a hand: ${words.guide}`);
    this.#drawFault(words);
  }

  #drawPermit() {
    const words = this.#words;
    if (words === null) return;
    const permit = at("permit");
    const by = words.owner ? ` by ${words.owner}` : "";
    const armed = this.#tick ? this.#tick.armed : words.armed;
    permit.dataset.armed = armed && !this.#stale;
    if (this.#stale) {
      say(permit, armed ? `was armed${by}` : "was not armed");
      return;
    }
    const hint = this.#tick ? next(words.mode, this.#tick.moving, this.#quiet_s - this.#tick.quiet_s) : "";
    const after = hint ? ` · ${hint}` : "";
    if (!armed) {
      say(permit, `not armed${after}`);
      return;
    }
    const left = Number.isNaN(this.#left_s) ? "" : ` for another ${duration(this.#left_s)}`;
    const while_ = words.until_told || Number.isNaN(this.#left_s) ? "" : ", unless renewed";
    say(permit, `ARMED${by}${left}${while_}${after}`);
  }

  /** Show the daemon's time of these figures, and what the joints detect. */
  #drawNow() {
    const live = at("live");
    live.dataset.live = !this.#stale;
    const time = Number.isNaN(this.#wall_s) ? "" : clock(this.#wall_s);
    say(live, this.#stale ? `◌ not live${time && `, as of ${time}`}` : `● live, ${time}`);
    if (this.#tick === null) return;
    const what = felt(this.#joints, this.#tick);
    const unknown = notSensing(this.#joints, this.#tick);
    const known = what ? `▲ ${what}` : unknown ? "" : "nothing beyond its level";
    at("felt").dataset.beyond = what !== "";
    const force = this.#words?.force ? `${this.#words.force.text} at the tool` : "";
    const touch = this.#words?.touch ? `touched at ${this.#words.touch.text}` : "";
    const near = this.#words?.near ? `near: ${this.#words.near}` : "";
    say(at("felt"), `${this.#stale ? "Detected then" : "Detects"}: ${[known, force, touch, near, unknown].filter(Boolean).join(" · ")}`);
  }

  #drawLoad(load) {
    show(at("load"), Boolean(load));
    if (!load) return;
    const what = load.announced ? "The arm carries an announced load" : "There seems to be an unannounced load";
    say(at("load"), `${this.#stale ? "Then: " : ""}${what}: ${load.text}.`);
  }

  #drawStream() {
    const phase = this.#words?.stream ?? "";
    show(at("stream"), phase !== "");
    const quality = this.#advice?.stream ?? "";
    say(at("stream"), `${this.#stale ? "Then: stream" : "Stream"} ${[phase, quality].filter(Boolean).join(" · ")}`);
  }

  #drawFault(words) {
    const faulted = words.mode === "faulted";
    const doubts = [];
    if (words.unproved.length) doubts.push(`Not seen to stand: ${words.unproved.join(", ")}.`);
    if (words.silenced) doubts.push("contactd sends nothing to the drives until the fault is reset.");
    show(at("fault"), faulted);
    if (faulted) {
      say(at("fault-cause"), `${this.#stale ? "It was a fault" : "Fault"}: ${words.cause}`);
      sayLinked(at("fault-advice"), [...doubts, this.#todo()].filter(Boolean).join(" "));
    }
    const hint = faulted ? "" : this.#todo();
    show(at("hint"), hint !== "" && !this.#stale);
    sayLinked(at("hint"), hint);
  }

  #todo() {
    const [asked, known] = [this.#advice?.advice ?? "", this.#words?.advice ?? ""];
    // The answer to the status request may date from before the fault, and its daemon may have ended since.
    const advice = (asked.includes(known) ? asked : known).replaceAll("`", "");
    return advice ? `What to do: ${advice.replaceAll("\n", "; ")}.` : "";
  }
}

/** Draw the tabs of several arms, each with its mode. They are links, so that a reload shows the same arm;
    those of arms on other machines lead to their rows. */
export function drawTabs(names, shown, summary, others) {
  const tabs = at("tabs");
  show(tabs, names.length + others.length > 1);
  if (names.length + others.length < 2) return;
  const links = names.map((name, i) => {
    const mode = summary?.modes[i] ?? "";
    const [sign, word] = MODES[mode] ?? ["✖", "no connection"];
    const armed = summary?.armed[i] ? ", armed" : "";
    const state = make("span", { "data-mode": mode || "gone" }, `${sign} ${word}${armed}`);
    const current = i === shown ? "page" : undefined;
    return make("a", { href: `?arm=${i}`, "aria-current": current }, name, " ", state);
  });
  const elsewhere = others.map((other) => {
    const known = other.silent || other.state !== "alive" ? "gone" : other.mode;
    return make("a", { href: `#${placeOf(other.arm)}`, "data-elsewhere": true }, other.arm, " ",
      make("span", { "data-mode": known }, stateOf(other)));
  });
  tabs.replaceChildren(...links, ...elsewhere);
}

function sentence(text) {
  return `${text[0].toUpperCase()}${text.slice(1)}.`;
}
