// Stop and disarm: an HTTP request each, which needs neither the stream nor the picture.

import { at, say, show } from "./dom.js";

const WITHIN_MS = 1000;
const SHOWN_MS = 12000;
const LOST_MS = 10000; // an answer that takes longer never comes; its connection is given back
const NOT_REACHED = "NOT REACHED: use the emergency stop.";

/** Result of a command in words for the person at the arm, and how good it is. */
export function outcomeOf(found) {
  switch (found.outcome) {
    case "stands":
      return ["good", `It stands (${found.mode}), disarmed.`];
    case "disarmed":
      return ["good", `Disarmed (${found.mode}).`];
    case "not seen to stand":
      return ["bad", `Stop is given, but the arm is not seen to stand: ${found.text}. Use the emergency stop if it moves.`];
    case "refused":
      return ["bad", `Refused: ${found.text}. Use the emergency stop.`];
    default:
      return ["bad", `${NOT_REACHED} (${found.text})`];
  }
}

/** Ask for a command; the header is one that no form of another site can send. */
export async function post(path, command) {
  const response = await fetch(path, {
    method: "POST",
    headers: { "X-Contactd-Command": command },
    cache: "no-store",
    signal: AbortSignal.timeout(LOST_MS),
  });
  if (!response.ok) throw new Error((await response.text()).trim() || `status ${response.status}`);
  return response.json();
}

export class Commands {
  #arm; #number = 0; #forget = null; #said_ms = 0;

  constructor(arm) {
    this.#arm = arm;
    at("stop").addEventListener("click", () => this.send("stop"));
    at("disarm").addEventListener("click", () => this.send("disarm"));
    // Wherever the focus is, and whatever else listens.
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !event.repeat && !at("commands").hidden) this.send("stop");
    }, { capture: true });
  }

  /** Let people command, or not. */
  allow(may) {
    show(at("commands"), may);
  }

  /** Send, and say within a second what became of it. */
  async send(command) {
    const number = ++this.#number;
    this.#say("waiting", command === "stop" ? "Stopping" : "Disarming", number);
    const late = setTimeout(() => this.#say("bad", `${NOT_REACHED} (no answer yet)`, number), WITHIN_MS);
    try {
      const found = await post(`arms/${this.#arm}/${command}`, command);
      const [kind, text] = outcomeOf(found);
      this.#say(kind, text, number, found.outcome);
    } catch (error) {
      this.#say("bad", `${NOT_REACHED} (${error.message})`, number);
    } finally {
      clearTimeout(late);
    }
  }

  /** Take note of whether the arm is seen to stand now: what was said of it may have changed. */
  seen(stands, mode) {
    const outcome = at("outcome");
    // The stream may be a moment behind the answer.
    const settled = performance.now() - this.#said_ms > 500;
    if (!stands && settled && outcome.dataset.outcome === "stands") this.#clear();
    if (stands && outcome.dataset.outcome === "not seen to stand") {
      this.#say("good", `It stands now (${mode}).`, this.#number, "stands");
    }
  }

  #say(kind, text, number, found = "") {
    if (number !== this.#number) return;
    const outcome = at("outcome");
    this.#said_ms = performance.now();
    outcome.dataset.outcome = found;
    outcome.dataset.kind = kind;
    show(outcome, true);
    say(outcome, text);
    clearTimeout(this.#forget);
    if (kind === "good") this.#forget = setTimeout(() => this.#clear(), SHOWN_MS);
  }

  #clear() {
    show(at("outcome"), false);
    say(at("outcome"), "");
    at("outcome").dataset.outcome = at("outcome").dataset.kind = "";
  }
}
