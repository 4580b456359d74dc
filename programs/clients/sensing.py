"""Words on the sensing of contact: which joints do not sense now, and since when."""

from collections.abc import Sequence

from daemon.modes.table import SENSING, Mode
from daemon.protocol.replies import Status
from daemon.protocol.state import State

LOST = 0.01
"""Share of lost samples from which on they are shown."""


def not_sensing(shown: State | Status, joints: Sequence[str]) -> str:
    """Joints that do not sense contact now, and for how long, in one line; empty if all do, or if
    this is unknown."""
    if shown.sensing is None or shown.sensing_since_s is None:
        return ""
    by_time: dict[str, list[str]] = {}
    for joint, senses, since_s in zip(joints, shown.sensing, shown.sensing_since_s, strict=True):
        if not senses:
            by_time.setdefault(f"for {_now_s(shown) - since_s:.1f} s", []).append(joint)
    if not by_time:
        return ""
    parts = [
        f"{'all joints' if len(names) == len(joints) > 1 else ', '.join(names)} {time}"
        for time, names in by_time.items()
    ]
    return f"not sensing contact: {'; '.join(parts)}"


def sensing_for_s(shown: State | Status) -> float | None:
    """Time for which all joints have sensed contact [s]; None if one does not, if this is unknown,
    or in a mode without sensing."""
    if not shown.sensing or not all(shown.sensing) or Mode(shown.mode) not in SENSING:
        return None
    return _now_s(shown) - max(shown.sensing_since_s or [0.0])


def lost_samples(status: Status) -> str:
    """Recent shares of lost samples by joint, from 1 % on; empty if there are none."""
    lost = zip(status.joints, status.lost or [], strict=False)
    many = [f"{joint} {share:.0%}" for joint, share in lost if share >= LOST]
    return f"lost recently: {', '.join(many)}" if many else ""


def _now_s(shown: State | Status) -> float:
    return shown.time_s if isinstance(shown, State) else shown.uptime_s
