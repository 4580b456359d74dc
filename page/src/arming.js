// What arming needs: the daemon's checks, the failing ones first.

import { at, make, say } from "./dom.js";

/** Draw the checks of a Status. `armed`: the arm is armed, whatever they say; `stale`: the Status is a past one. */
export function drawArming({ checks }, armed, stale) {
  sayArming(checks, armed, stale);
  const failed = checks.filter((check) => !check.passed);
  const line = (check) =>
    make("li", { class: check.passed ? "passed" : "failed" },
      make("span", { class: "sign" }, check.passed ? "✓" : "✖"),
      make("span", {}, make("strong", {}, check.name), ` ${check.text.replaceAll("`", "")}`));
  const passed = checks.filter((check) => check.passed);
  const open = at("checks").querySelector("details")?.open ?? false;
  const rest = make("li", { class: "rest" },
    make("details", { open }, make("summary", {}, `${passed.length} passed`),
      make("ul", {}, ...passed.map(line))));
  at("checks").replaceChildren(...failed.map(line), ...(passed.length ? [rest] : []));
}

/** Show the result of the checks, without redrawing them. */
export function sayArming(checks, armed, stale) {
  const failed = checks.filter((check) => !check.passed).length;
  say(at("arming-note"), (stale ? noteThen : note)(failed, checks.length, armed));
}

function noteThen(failed, all, armed) {
  if (armed) return failed ? "It was armed. To arm it then, these checks would have failed:" : "It was armed.";
  return failed ? `${failed} of ${all} checks failed then:` : `All ${all} checks passed then.`;
}

function note(failed, all, armed) {
  if (armed) return failed ? "It is armed. To arm it now, these checks would fail:" : "It is armed.";
  if (failed) return `${failed} of ${all} checks fail: arming would be refused.`;
  return `All ${all} checks pass. Arm with contactctl; a browser cannot.`;
}
