// Stop and disarm: one HTTP request each, which needs neither the stream nor the picture.

import { at, say, show } from "./dom.js";

const WITHIN_MS = 1000;
const SHOWN_MS = 12000;
const LOST_MS = 10000; // after this an answer is given up, and its connection freed
const NOT_REACHED = "NOT REACHED: use the emergency stop.";

/** Kind of the outcome of a command (good or bad), and its text for the person at the arm. */
export function outcomeOf(found) {
  switch (found.outcome) {
    case "stands":
      return ["good", `It stands (${found.mode}), disarmed.`];
    case "disarmed":
      return ["good", `Disarmed (${found.mode}).`];
    case "not seen to stand":
      return ["bad", `The stop was given, but the arm is not seen to stand: ${found.text}. Use the emergency stop if it moves.`];
    case "refused":
      return ["bad", `Refused: ${found.text}. Use the emergency stop.`];
    default:
      return ["bad", `${NOT_REACHED} (${found.text})`];
  }
}

/** Post a command. A form of another site cannot send its header. */
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
    // Whatever has the focus, and whatever else handles the key.
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !event.repeat && !at("commands").hidden) this.send("stop");
    }, { capture: true });
  }

  /** Allow commands, or not. */
  allow(may) {
    show(at("commands"), may);
  }

  /** Send a command, and show its outcome, or that there is none yet, within WITHIN_MS. */
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

  /** Take whether the arm is now seen to stand: the outcome that is shown may no longer hold. */
  seen(stands, mode) {
    const outcome = at("outcome");
    // The stream may lag behind the answer.
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
