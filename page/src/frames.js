// Binary frames of ticks, as programs/web/frames.py packs them.

export const VERSION = 1;
export const SIDES = ["left", "gap", "right", "unknown"];
export const VECTORS = ["residual", "threshold", "phi", "phi_sigma", "link_position"];
const HEADER_BYTES = 44;
const TICK_BYTES = 24;
const ARMED = 1, MOVING = 2;
const SENSING = 4, FRESH = 8, TOUCHED = 16, COLLISION = 32, UNPROVED = 64;

/** Frames of one message, each preceded by its length. Throws if it is not such a message. */
export function* framesOf(buffer) {
  const view = new DataView(buffer);
  let at = 0;
  while (at < buffer.byteLength) {
    const length = view.getUint32(at, true);
    yield decode(new DataView(buffer, at + 4, length));
    at += 4 + length;
  }
}

/** One frame: its header and its ticks in order. */
export function decode(view) {
  if (view.getUint8(0) !== VERSION) throw new Error("the page is older than its server: reload it");
  const joints = view.getUint8(2);
  const count = view.getUint16(4, true);
  const head = {
    past: view.getUint8(1) === 1,
    missed: view.getUint32(8, true),
    monotonic_s: view.getFloat64(12, true),
    begin_s: view.getFloat64(20, true),
    wall_s: view.getFloat64(28, true),
    left_s: view.getFloat64(36, true),
    ticks: [],
  };
  let at = HEADER_BYTES;
  for (let i = 0; i < count; i++) {
    const [tick, next] = decodeTick(view, at, joints, head.begin_s);
    head.ticks.push(tick);
    at = next;
  }
  return head;
}

function decodeTick(view, at, joints, begin_s) {
  const flags = view.getUint8(at + 21);
  const tick = {
    tick: view.getUint32(at, true),
    time_s: begin_s + view.getFloat32(at + 4, true),
    quiet_s: view.getFloat32(at + 8, true),
    lateness_s: view.getFloat32(at + 12, true),
    work_s: view.getFloat32(at + 16, true),
    mode: view.getUint8(at + 20),
    armed: (flags & ARMED) !== 0,
    moving: (flags & MOVING) !== 0,
    joints: [],
  };
  at += TICK_BYTES;
  for (let i = 0; i < joints; i++) tick.joints.push(jointFlags(view.getUint8(at + i)));
  at += joints + ((4 - (joints % 4)) % 4);
  for (const name of VECTORS) {
    const values = new Array(joints);
    for (let i = 0; i < joints; i++) values[i] = view.getFloat32(at + 4 * i, true);
    tick[name] = values;
    at += 4 * joints;
  }
  return [tick, at];
}

function jointFlags(byte) {
  return {
    side: SIDES[byte & 3],
    sensing: (byte & SENSING) !== 0,
    fresh: (byte & FRESH) !== 0,
    touched: (byte & TOUCHED) !== 0,
    collision: (byte & COLLISION) !== 0,
    unproved: (byte & UNPROVED) !== 0,
  };
}
