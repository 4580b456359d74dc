"""Reports on limit cycles: which joints oscillate, how fast, and the gain that ends it."""

from collections.abc import Sequence

import numpy as np

from common.arrays import Matrix, Vector
from daemon.protocol.state import State
from identification.limit_cycle import ENDING_SHARE, WINDOW_S, LimitCycle, limit_cycles
from identification.motion_log import MotionLog

_LOOKED_AT_S = 2.5 * WINDOW_S
_EVERY_S = 2.0


def limit_cycle_sentence(cycles: Sequence[LimitCycle], gain: float | None) -> str:
    """Sentence about joints in a limit cycle, with the gain [1/s] that ends it; empty if none.

    gain: of the position loop that moved them [1/s]; None if another controller did.
    """
    if not cycles:
        return ""
    names = ", ".join(cycle.joint for cycle in cycles)
    swing = "swings by itself" if len(cycles) == 1 else "swing by themselves"
    first = cycles[0]
    about = f"{names} {swing} at {first.frequency_Hz:.1f} Hz, by +-{1e3 * first.amplitude:.2g} mrad"
    if gain is None:
        return f"{about}, unless that was commanded: try a quarter of its position loop's gain"
    lower = f"{ENDING_SHARE * gain:.2g} (it was {gain:g})"
    return (
        f"{about}: the position loop is too fast for its gap. Set control.position_gain to "
        f"{lower}, and repeat"
    )


def limit_cycle_sentences(cycles: Sequence[LimitCycle], gain: float | None) -> dict[str, str]:
    """Sentence for each joint whose limit cycle spoils the identification; gain as above."""
    return {one.joint: limit_cycle_sentence([one], gain) for one in cycles if one.spoils}


class LimitCycleWatch:
    """Detector of limit cycles during a motion, which evaluates the last seconds periodically."""

    def __init__(self, joints: Sequence[str], gain: float, half_gap: Vector) -> None:
        """Gain of the position loop [1/s]; half_gap (n,) [rad]."""
        self._joints, self._gain, self._half_gap = tuple(joints), gain, half_gap
        self._states: list[State] = []
        self._reported = False

    def add(self, state: State) -> str:
        """Add one State; returns the sentence once, when a limit cycle is first detected."""
        if self._reported:
            return ""
        if all(state.fresh):
            self._states.append(state)
        begun, now = self._states[0].time_s if self._states else state.time_s, state.time_s
        if now - begun < _LOOKED_AT_S:
            return ""
        text = limit_cycle_sentence(limit_cycles(*self._log(), self._half_gap), self._gain)
        self._reported = bool(text)
        self._states = [s for s in self._states if now - s.time_s < _LOOKED_AT_S - _EVERY_S]
        return text

    def _log(self) -> tuple[MotionLog, Matrix]:
        def column(name: str) -> Matrix:
            return np.array([getattr(s, name) for s in self._states])

        time_s: Vector = np.array([s.time_s for s in self._states])
        names = ("current", "link_position", "motor_velocity")
        return MotionLog(self._joints, time_s, *map(column, names)), column("reference")
