// Modes, durations and numbers in words. Pure.

// A sign beside each mode, because no state may be shown by its colour alone.
export const MODES = {
  off: ["○", "off", "the drives are not energised"],
  enabling: ["◔", "enabling", "the drives are being switched on"],
  holding: ["■", "holding", "the arm holds its position"],
  tracking: ["▶", "tracking", "the arm moves along its trajectory"],
  admittance: ["↔", "yielding", "the arm yields to the hand that pushes it"],
  retracting: ["↶", "retracting", "the arm moves back from the contact"],
  returning: ["↩", "returning", "the arm returns to its trajectory"],
  releasing: ["⇄", "releasing", "the arm relieves the force of a collision"],
  stopping: ["▼", "stopping", "the arm decelerates"],
  faulted: ["✖", "fault", "quick stop, until a person resets the fault"],
};

const GUIDED = new Set(["admittance", "retracting"]);

/** Text on what happens in left_s, without contact; empty if that is obvious. */
export function next(mode, moving, left_s) {
  if (!GUIDED.has(mode)) return "";
  return `${moving ? "continues" : "holds"} in ${Math.max(left_s, 0).toFixed(1)} s if untouched`;
}

/** Whether joint i detects contact beyond its level. A joint that is not sensing does not, whatever its last
    residual. */
export function isBeyond({ residual, threshold, joints }, i) {
  return joints[i].sensing && Math.abs(residual[i]) > threshold[i];
}

/** Text on the joints whose contact is unknown because they are not sensing; empty if all are sensing. */
export function notSensing(names, { joints }) {
  const which = names.filter((_, i) => !joints[i].sensing);
  if (which.length === names.length) return "unknown, no joint is sensing";
  return which.length ? `unknown for ${which.join(", ")}` : "";
}

/** Text on the joints whose residual is beyond their level, the strongest first; empty for none. */
export function felt(joints, tick) {
  const { residual, threshold } = tick;
  const share = (i) => Math.abs(residual[i]) / threshold[i];
  const beyond = joints.map((_, i) => i).filter((i) => isBeyond(tick, i)).sort((a, b) => share(b) - share(a));
  return beyond.map((i) => `${joints[i]} ${signed(residual[i], 1)} Nm`).join(", ");
}

/** Duration as text: 0.5 s, 42 s, 9 min 12 s, 1 h 4 min. */
export function duration(seconds) {
  if (seconds < 10) return `${Math.max(seconds, 0).toFixed(1)} s`;
  const whole = Math.round(seconds);
  const [h, min, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  if (h) return `${h} h ${min} min`;
  return min ? `${min} min ${s} s` : `${s} s`;
}

/** Time of day of a Unix time [s], as text. */
export function clock(wall_s, digits = 0) {
  const date = new Date(1e3 * wall_s);
  const two = (n) => String(n).padStart(2, "0");
  const rest = digits ? (date.getMilliseconds() / 1e3).toFixed(digits).slice(1) : "";
  return `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}${rest}`;
}

/** Number with its sign (U+2212 for minus) and this many decimals. */
export function signed(value, digits = 2) {
  return `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(digits)}`;
}

/** Number with U+2212 for minus and this many decimals; zero has no sign. */
export function fixed(value, digits) {
  const text = Math.abs(value).toFixed(digits);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

/** Size of a file as text. */
export function size(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Text for each side of a joint's gap. */
export const SIDES = {
  left: "at the left side",
  right: "at the right side",
  gap: "in the gap",
  unknown: "side unknown",
};

/** Text on what was learned about joint i since its identification; empty if nothing was. */
export function learned(found, i) {
  if (!found) return "";
  const names = [["coulomb", "friction"], ["viscous", "viscous friction"],
    ["load", "friction of load"]];
  const parts = names
    .filter(([key]) => Math.abs(found[key][i]) >= 0.005)
    .map(([key, name]) => `${name} ${signed(100 * found[key][i], 0)} %`);
  return parts.length ? `learned: ${parts.join(", ")}` : "";
}
