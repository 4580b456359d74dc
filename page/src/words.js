// Modes, durations and numbers in words. Pure.

// A sign beside each mode: no state is shown by its colour alone.
export const MODES = {
  off: ["○", "off", "the drives have no power over the arm"],
  enabling: ["◔", "enabling", "the drives are being switched on"],
  holding: ["■", "holding", "the arm stands"],
  tracking: ["▶", "tracking", "the arm moves along its trajectory"],
  admittance: ["↔", "yielding", "the arm follows the hand that pushes it"],
  retracting: ["↶", "retracting", "the arm backs away from what it met"],
  returning: ["↩", "returning", "the arm goes back to its trajectory"],
  releasing: ["⇄", "releasing", "the arm lets go of what it hit"],
  stopping: ["▼", "stopping", "the arm decelerates"],
  faulted: ["✖", "fault", "quick stop, until a person resets it"],
};

const GUIDED = new Set(["admittance", "retracting"]);

/** What happens after this mode, in words; empty where that is plain. */
export function next(mode, moving, quiet_s) {
  if (!GUIDED.has(mode)) return "";
  return `quiet for ${quiet_s.toFixed(1)} s, then it ${moving ? "goes on" : "holds"}`;
}

/** Whether joint i feels more than its level. One that senses nothing does not, whatever its residual was last. */
export function isBeyond({ residual, threshold, joints }, i) {
  return joints[i].sensing && Math.abs(residual[i]) > threshold[i];
}

/** Of which joints it is not known what they feel, since they sense nothing; empty where all sense. */
export function deaf(names, { joints }) {
  const which = names.filter((_, i) => !joints[i].sensing);
  if (which.length === names.length) return "not known, no joint senses";
  return which.length ? `not known of ${which.join(", ")}` : "";
}

/** What joints feel beyond their level, in words, the strongest first; empty for nothing. */
export function felt(joints, tick) {
  const { residual, threshold } = tick;
  const share = (i) => Math.abs(residual[i]) / threshold[i];
  const beyond = joints.map((_, i) => i).filter((i) => isBeyond(tick, i)).sort((a, b) => share(b) - share(a));
  return beyond.map((i) => `${joints[i]} ${signed(residual[i], 1)} Nm`).join(", ");
}

/** Duration for people: 0.5 s, 42 s, 9 min 12 s, 1 h 4 min. */
export function duration(seconds) {
  if (seconds < 10) return `${Math.max(seconds, 0).toFixed(1)} s`;
  const whole = Math.round(seconds);
  const [h, min, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  if (h) return `${h} h ${min} min`;
  return min ? `${min} min ${s} s` : `${s} s`;
}

/** Time of the day of a Unix time [s]. */
export function clock(wall_s, digits = 0) {
  const date = new Date(1e3 * wall_s);
  const two = (n) => String(n).padStart(2, "0");
  const rest = digits ? (date.getMilliseconds() / 1e3).toFixed(digits).slice(1) : "";
  return `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}${rest}`;
}

/** Number with its sign, a true minus, and so many decimals. */
export function signed(value, digits = 2) {
  return `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(digits)}`;
}

/** Number with a true minus where it is negative, and so many decimals; zero has no sign. */
export function fixed(value, digits) {
  const text = Math.abs(value).toFixed(digits);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

/** Size of a file. */
export function size(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Side of a joint's gap in words. */
export const SIDES = {
  left: "at the left side",
  right: "at the right side",
  gap: "in the gap",
  unknown: "side not known",
};

/** What was learned of joint i since it was identified; empty where nothing was. */
export function learned(found, i) {
  if (!found) return "";
  const names = [["coulomb", "friction"], ["viscous", "viscous friction"],
    ["load", "friction of load"]];
  const parts = names
    .filter(([key]) => Math.abs(found[key][i]) >= 0.005)
    .map(([key, name]) => `${name} ${signed(100 * found[key][i], 0)} %`);
  return parts.length ? `learned: ${parts.join(", ")}` : "";
}
