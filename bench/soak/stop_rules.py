"""Rules of stops: seen to stand, gone no further than is printed, and ended by one reset."""

import numpy as np
from numpy.typing import NDArray

from bench.soak.record import Ledger
from common.arrays import Vector
from daemon.config.schema import Configuration
from daemon.modes.table import Mode
from daemon.protocol.state import State
from daemon.tick.controller import RESET_TIMEOUT_S
from daemon.tick.notices import STOP_PROVED
from programs.contactd.travels import travels

# No motor moves so long after a proof [s], faster than one that stands [rad/s], in so many readings
# in a row: a link that falls through its gap gives its motor one knock.
AFTER_PROOF_S = 0.3
STANDS = 0.05
KNOCK_READINGS = 2
PROVED_S = 1.0  # A stop must be proved, or the drives be left to themselves, within [s]
LONGEST_TICK_S = 0.1  # However long a tick took, the drives had one chance to be seen [s]
# After a reset nothing old comes back for [s]: a drive has RESET_TIMEOUT_S to leave its fault.
RESET_HOLDS_S = RESET_TIMEOUT_S + 0.1
HAND_S = 1.0  # Arm and drives still give way so long after a hand is off [s]

RESET = f"{Mode.FAULTED} -> {Mode.OFF}:"  # Notice of a reset


class StopRules:
    """Check of one State after the other; `ledger` keeps what was broken."""

    def __init__(self, c: Configuration, ledger: Ledger) -> None:
        self._ledger, self._names = ledger, c.joint_names
        self._travel = np.array([travel.total for travel in travels(c)])
        self._before: State | None = None
        self._joints: Vector | None = None  # last known
        self._began: Vector | None = None  # at the fault; None once a hand was there
        self._hand_s = -np.inf
        self._proved_s = np.inf
        self._moving = np.zeros(len(c.joints), dtype=np.int64)  # readings in a row that say so
        self._doubted_s = 0.0  # for how long the stop has not been proved
        self._reset_s = np.inf  # time of a reset that nothing has excused since

    def see(
        self, state: State, *, joints: Vector, speed: Vector, touched: bool, trouble: bool
    ) -> None:
        """Check one State.

        joints (k, n) [rad] and speed (n,) [rad/s]: positions and motor velocities, NaN where they
        are not known. touched: a hand is on the arm. trouble: a fault is being made.
        """
        if self._joints is not None:
            joints = np.where(np.isnan(joints), self._joints, joints)
        if touched:
            self._hand_s = state.time_s
        by_hand = state.time_s <= self._hand_s + HAND_S
        faulted = state.mode == Mode.FAULTED
        self._one_reset(state, trouble)
        if faulted:
            self._travels(state, joints, by_hand)
            self._stays(state, speed, by_hand)
            self._is_proved(state, by_hand, stands=bool((np.abs(speed) < STANDS).all()))
        else:
            self._proved_s, self._doubted_s = np.inf, 0.0
        self._before, self._joints = state, joints

    def _travels(self, state: State, joints: Vector, by_hand: bool) -> None:
        """From the last tick before the fault on, no joint goes further than is printed."""
        if self._before is None or self._before.mode != Mode.FAULTED:
            self._began = joints if self._joints is None else self._joints
        if by_hand:
            self._began = None
        if self._began is None:
            return
        gone = np.abs(joints - self._began).max(axis=0)
        self._all("no joint goes further than is printed", gone > self._travel, state, gone, "rad")

    def _stays(self, state: State, speed: Vector, by_hand: bool) -> None:
        """A stop that was proved lasts until `reset`."""
        if any(notice.text == STOP_PROVED for notice in state.notices):
            self._proved_s = min(self._proved_s, state.time_s)
        if state.time_s > self._proved_s + AFTER_PROOF_S and not by_hand:
            self._moving = np.where(np.abs(speed) >= STANDS, self._moving + 1, 0)
            moves = self._moving > KNOCK_READINGS
            self._all("no motion after a proved stop", moves, state, speed, "rad/s")
        else:
            self._moving[:] = 0

    def _is_proved(self, state: State, by_hand: bool, *, stands: bool) -> None:
        """Every stop is proved once the arm stands, or else the drives are left to themselves. A
        hand that creeps with a joint of an arm that stood makes it move for as long as it likes."""
        before_s = self._before.time_s if self._before else state.time_s
        moved = by_hand and self._proved_s < np.inf
        doubted = bool(state.unproved) and not state.silenced and not moved and stands
        passed = min(state.time_s - before_s, LONGEST_TICK_S)
        self._doubted_s = self._doubted_s + passed if doubted else 0.0
        words = f"{', '.join(state.unproved)} for {self._doubted_s:.2f} s"
        in_time = self._doubted_s <= PROVED_S
        self._ledger.check("a stop is proved or the arm silent", in_time, state.time_s, words)

    def _one_reset(self, state: State, trouble: bool) -> None:
        """After a reset no fault comes back whose cause is gone."""
        before, now = self._before, state.time_s
        missed = before is not None and state.timing.missed > before.timing.missed
        if trouble or missed:  # a new cause
            self._reset_s = np.inf
        elif any(notice.text.startswith(RESET) for notice in state.notices):
            self._reset_s = now  # in the same State it may be faulted again
        if self._reset_s == np.inf:
            return
        again, over = state.mode == Mode.FAULTED, now > self._reset_s + RESET_HOLDS_S
        if again or over:
            words = f"{state.cause}, {now - self._reset_s:.2f} s after it"
            self._ledger.check("one reset is enough", over, now, words)
            self._reset_s = np.inf

    def _all(
        self, rule: str, wrong: NDArray[np.bool_], state: State, values: Vector, unit: str
    ) -> None:
        words = ", ".join(f"{self._names[i]} {values[i]:.4f} {unit}" for i in np.flatnonzero(wrong))
        self._ledger.check(rule, not wrong.any(), state.time_s, f"{words} ({state.cause})")
