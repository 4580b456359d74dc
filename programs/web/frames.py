"""Binary frames of the page: several ticks of one arm. Pure functions; decoded by
`page/src/frames.js`.

Little-endian. A header is followed by the ticks, each with scalars, a byte of flags per joint, and
the vectors of `VECTORS`, one float32 per joint. Seven joints take 172 bytes per tick.
"""

import struct
from collections.abc import Sequence
from typing import Final

from daemon.modes.table import Mode
from daemon.protocol.state import State

VERSION: Final = 1
MODES: Final = tuple(Mode)
SIDES: Final = ("left", "gap", "right", "unknown")
VECTORS: Final = ("residual", "threshold", "phi", "phi_sigma", "link_position")

# version, 1 for past ticks, number of joints, number of ticks, deadlines missed since the start,
# CLOCK_MONOTONIC of the last tick [s], loop time of the first [s], Unix time of the last [s],
# remaining lease at the last [s] (NaN: not armed)
HEADER: Final = struct.Struct("<BBBxHxxI4d")
# tick, time since the first tick, quiet time, lateness of the wake-up, work [s], mode, flags
TICK: Final = struct.Struct("<I4fBBxx")
ARMED, MOVING = 1, 2
# Flags of a joint; the two lowest bits encode its side.
SENSING, FRESH, TOUCHED, COLLISION, UNPROVED = 4, 8, 16, 32, 64


def encode(states: Sequence[State], joints: Sequence[str], *, past: bool = False) -> bytes:
    """Frame of at least one State, all with these joints."""
    first, last = states[0], states[-1]
    left_s = last.permit.left_s if last.permit else float("nan")
    head = HEADER.pack(
        VERSION,
        past,
        len(joints),
        len(states),
        last.timing.missed,
        last.timing.monotonic_s,
        first.time_s,
        last.timing.wall_s,
        left_s,
    )
    vectors = struct.Struct(f"<{len(joints)}B{'' if not joints else f'{_padding(len(joints))}x'}")
    numbers = struct.Struct(f"<{len(VECTORS) * len(joints)}f")
    parts = [head]
    for state in states:
        parts += [
            _tick(state, first.time_s),
            vectors.pack(*_joint_flags(state, joints)),
            numbers.pack(*(x for name in VECTORS for x in getattr(state, name))),
        ]
    return b"".join(parts)


def as_past(frame: bytes) -> bytes:
    """Copy of a frame, marked as past."""
    return frame[:1] + b"\x01" + frame[2:]


def _padding(joints: int) -> int:
    return -joints % 4


def _tick(state: State, begin_s: float) -> bytes:
    timing = state.timing
    return TICK.pack(
        state.tick,
        state.time_s - begin_s,
        state.quiet_s,
        timing.lateness_us * 1e-6,
        timing.work_us * 1e-6,
        MODES.index(state.mode),
        ARMED * state.armed | MOVING * state.moving,
    )


def _joint_flags(state: State, joints: Sequence[str]) -> list[int]:
    """Flags by joint. Without the field `sensing`, which older daemons lack, joints count as
    sensing."""
    collided = {
        notice.contact.joint
        for notice in state.notices
        if notice.contact is not None and notice.contact.level == "collision"
    }
    senses = state.sensing or [True] * len(joints)
    return [
        SIDES.index(side)
        | SENSING * sensing
        | FRESH * fresh
        | TOUCHED * (name == state.touched_link)
        | COLLISION * (name in collided)
        | UNPROVED * (name in state.unproved)
        for name, side, sensing, fresh in zip(joints, state.side, senses, state.fresh, strict=True)
    ]
