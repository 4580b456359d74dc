"""Hold on the armed arm: which caller's calls of `arm` keep it armed, and for how long. Pure; time
is an argument.

Calls are the only sign of life of a caller: no other crosses every path within a second (decision
0003). Each call keeps the arm armed for HOLD_S from its sending. Its age is estimated by comparison
with the fastest of this caller's calls since arming: a call that was delayed more is worth less, so
that a network that holds calls back, suddenly or increasingly, prolongs nothing. The delay of the
fastest call itself cannot be known.

A caller that lost the arm for any reason must release it before it can arm again, as with an
enabling switch: a timer that repeats calls must not undo another client's `disarm`. Nor does a
single call arm, as its age is unknown.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final

HOLD_S: Final = 0.8
LEAST_S: Final = 0.05  # least lease: a shorter one would end before it is served
DRIFT: Final = 1e-3  # largest drift of a caller's clock against ours; slewing causes half of it
MOST_LOST: Final = 64
MOST_FIRST_CALLS: Final = 64
FIRST_CALL_S: Final = 0.3  # least time from a caller's first call to the one that arms
WOBBLE_S: Final = 0.05  # largest difference of their delays
RELEASE_FIRST: Final = "no longer armed: call with false first, then with true"
ONCE: Final = f"a single call may be an old one: keep calling, at least every {HOLD_S:g} s"


class Step(Enum):
    """Action to take at the daemon."""

    ARM = auto()
    RENEW = auto()
    DISARM = auto()
    NOTHING = auto()


@dataclass(frozen=True, slots=True)
class ArmCall:
    """One call with value `armed`, from the caller with this GID, sent at `sent_s` by its clock."""

    caller: bytes
    armed: bool
    sent_s: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of a call: a step with its lease [s], or the reason why there is none."""

    step: Step
    lease_s: float = 0.0
    why: str = ""


@dataclass(slots=True)
class Hold:
    """Caller that keeps the arm armed, if any, and those that lost it and have not released it."""

    _holder: bytes | None = None
    _until_s: float = 0.0
    _offset_s: float = 0.0  # our clock minus the holder's, by its fastest call
    _read_s: float = 0.0  # time of the last update of the offset
    _lost: deque[bytes] = field(default_factory=lambda: deque(maxlen=MOST_LOST))
    # Sending and arrival times of first calls, by caller.
    _first_calls: dict[bytes, tuple[float, float]] = field(default_factory=dict)

    def judge(self, call: ArmCall, now_s: float) -> Verdict:
        """Verdict on a call at time `now_s`."""
        if not call.armed:
            return Verdict(Step.DISARM)
        if call.caller == self._holder and now_s >= self._until_s:
            self.lose()
        if call.caller == self._holder:
            late_s = self._late_s(call.sent_s, now_s)
            if HOLD_S - late_s < LEAST_S:
                return Verdict(Step.NOTHING, why=f"{late_s:.1f} s later than its fastest call")
            return Verdict(Step.RENEW, HOLD_S - late_s)
        return self._of_another(call, now_s)

    def _of_another(self, call: ArmCall, now_s: float) -> Verdict:
        """Verdict on a call with true from a caller that does not hold the arm."""
        if call.caller in self._lost:
            return Verdict(Step.NOTHING, why=RELEASE_FIRST)
        if self._holder is not None and now_s < self._until_s:
            return Verdict(Step.NOTHING, why="another client keeps it armed")
        if not self._is_live(call, now_s):
            return Verdict(Step.NOTHING, why=ONCE)
        return Verdict(Step.ARM, HOLD_S)

    def _is_live(self, call: ArmCall, now_s: float) -> bool:
        """True if calls arrive at the intervals at which they were sent. A router that hung
        delivers its backlog at once, perhaps from a caller that is gone."""
        sent_s, came_s = self._first_calls.get(call.caller, (call.sent_s, now_s - 2.0 * HOLD_S))
        apart_s = now_s - came_s
        if apart_s > HOLD_S or abs(apart_s - (call.sent_s - sent_s)) > WOBBLE_S:
            self._first_calls.pop(call.caller, None)
            if len(self._first_calls) >= MOST_FIRST_CALLS:
                del self._first_calls[next(iter(self._first_calls))]
            self._first_calls[call.caller] = (call.sent_s, now_s)
            return False
        return apart_s >= FIRST_CALL_S

    def granted(self, call: ArmCall, lease_s: float, now_s: float) -> None:
        """Record that the daemon carried out the verdict on a call with true."""
        if call.caller != self._holder:
            self.lose()
            self._holder = call.caller
            self._first_calls.pop(call.caller, None)
            self._offset_s, self._read_s = now_s - call.sent_s, now_s
        self._until_s = now_s + lease_s

    def lose(self) -> None:
        """Record that the holder has lost the arm."""
        if self._holder is not None:
            self._lost.append(self._holder)
        self._holder = None

    def release(self, caller: bytes) -> None:
        """Record that this caller released the arm and may arm again; another holder loses it."""
        if self._holder == caller:
            self._holder = None
        self.lose()
        while caller in self._lost:
            self._lost.remove(caller)

    def _late_s(self, sent_s: float, now_s: float) -> float:
        drift_s = DRIFT * (now_s - self._read_s)
        self._offset_s = min(now_s - sent_s, self._offset_s + drift_s)
        self._read_s = now_s
        return now_s - sent_s - self._offset_s
