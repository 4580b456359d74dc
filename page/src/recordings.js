// Recordings: start, end, download, delete. The page's server writes them.

import { post } from "./commands.js";
import { at, make, say, show } from "./dom.js";
import { duration, size } from "./words.js";

const EVERY_MS = 2000;

export class RecordingsPanel {
  #arm; #shown = null; #looking = false;
  #sure = ""; // the file whose deletion waits for a second click
  #changes = 0; // starts and ends of requests: a list requested before the last one may be old

  constructor(arm) {
    this.#arm = arm;
    at("record").addEventListener("click", () => this.#toggle());
    setInterval(() => this.#look(), EVERY_MS);
  }

  /** Allow recording, or not. */
  allow(may) {
    show(at("recordings-section"), may);
    if (may) this.#look();
  }

  async #look() {
    if (at("recordings-section").hidden || document.hidden || this.#looking) return;
    this.#looking = true;
    try {
      const before = this.#changes;
      // Hanging requests would leave the browser no connection for a stop.
      const response = await fetch("recordings", { cache: "no-store", signal: AbortSignal.timeout(EVERY_MS) });
      const found = response.ok ? await response.json() : null;
      if (found && before === this.#changes) this.#draw(found);
    } catch {
      // The stream reports that there is no connection.
    }
    this.#looking = false;
  }

  async #toggle() {
    const running = this.#shown?.running;
    await this.#do(running ? "recordings/end" : `arms/${this.#arm}/record`, running ? "end" : "record");
  }

  async #do(path, command) {
    this.#changes += 1;
    try {
      this.#draw(await post(path, command));
    } catch (error) {
      say(at("record-note"), error.message);
    } finally {
      this.#changes += 1;
    }
  }

  #draw(found) {
    this.#shown = found;
    const running = found.running !== "";
    say(at("record"), running ? "■ End recording" : "● Record");
    const now = `${duration(found.seconds)}, ${size(found.bytes)}`;
    say(at("record-note"), running ? `Recording ${found.running}: ${now}` : found.said || `Room for ${size(found.room_bytes)}.`);
    at("recordings").replaceChildren(...found.files.map((file) => {
      const remove = make("button", { type: "button", "aria-label": `Delete ${file.name}` },
        this.#sure === file.name ? "Really delete?" : "Delete");
      remove.addEventListener("click", () => {
        const sure = this.#sure === file.name;
        this.#sure = sure ? "" : file.name;
        if (!sure) return say(remove, "Really delete?");
        remove.disabled = true;
        this.#do(`recordings/${file.name}/delete`, "delete");
      });
      return make("li", {},
        make("a", { href: `recordings/${file.name}`, download: file.name }, file.name),
        ` ${size(file.bytes)} `, remove);
    }));
  }
}
