"""Live identification of one joint's gap while a person moves its link by hand."""

import numpy as np

from daemon.protocol.state import State
from identification.gap import identify_gap
from identification.gap_result import CROSSINGS, GapResult
from identification.motion_log import PAUSE_S, MotionLog

REFRESH_S = 0.2
JUDGE_S = 2.0
LEAST_ROWS = 200
ENOUGH = CROSSINGS + 5
"""Crossings after which a usable gap ends the step."""


class Hand:
    """Samples of phi of one joint moved by hand, and the gap identified from them so far."""

    def __init__(
        self, joint: int, torque_constant: float, name: str, before: MotionLog | None = None
    ) -> None:
        self._joint, self._constant, self._name, self._before = joint, torque_constant, name, before
        self._rows: list[tuple[float, ...]] = []
        self._shown_s = self._judged_s = -1.0
        self.phi: list[float] = []
        self.gap: GapResult | None = None
        self.done = False

    def add(self, state: State) -> bool:
        """Add one State; True if the display is due."""
        if not all(state.fresh):
            return False
        i, measured = self._joint, state.motor_position
        if not self._rows and self._before is not None:
            self._rows = rows_until(self._before, i, state.time_s - 2.0 * PAUSE_S)
        row = (state.time_s, state.current[i], state.link_position[i], state.motor_velocity[i])
        self._rows.append(row if measured is None else (*row, measured[i]))
        motor = state.motor_estimate if measured is None else measured
        self.phi.append(state.link_position[i] - motor[i])
        now = state.time_s
        if now - self._judged_s > JUDGE_S and len(self._rows) > LEAST_ROWS:
            self._judged_s = now
            time_s, *columns = np.array(self._rows).T
            log = MotionLog((self._name,), time_s, *(column[:, None] for column in columns))
            self.gap = identify_gap(log, 0, self._constant, by_hand=True)
            self.done = self.gap.usable and self.gap.crossings >= ENOUGH
        if now - self._shown_s < REFRESH_S and not self.done:
            return False
        self._shown_s = now
        return True


def rows_until(log: MotionLog, joint: int, time_s: float) -> list[tuple[float, ...]]:
    """Rows of one joint, shifted in time so that the log ends at `time_s`: time, current, link
    position, motor velocity and, if measured, motor position."""
    columns = [log.current, log.link_position, log.motor_velocity]
    if log.motor_position is not None:
        columns.append(log.motor_position)
    times = log.time_s - log.time_s[-1] + time_s
    rows = np.column_stack([times, *(column[:, joint] for column in columns)])
    return [tuple(row) for row in rows.tolist()]
