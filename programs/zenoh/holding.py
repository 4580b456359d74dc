"""Hold on the armed arm: whose calls of `arm` keep it armed, and for how long. Pure; time is an
argument.

A caller is heard by nothing but its calls: no other sign of it crosses every path within a second
(decision 0003). Each call keeps the arm armed for HOLD_S from when it was sent, as far as that is
known: from when it would have come by the fastest of this caller's calls since it armed. What
waited on its way is worth less, so a network that holds calls back prolongs nothing, be it all at
once or more and more. What even the fastest call waited cannot be known.

A caller that lost the arm, by whatever, has to let go before it arms again, as with an enabling
switch: calls that are repeated by a timer must not undo a `disarm` from elsewhere. And one call
alone does not arm: its age is not known.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final

HOLD_S: Final = 0.8
LEAST_S: Final = 0.05  # of a lease: less ends before it is served
DRIFT: Final = 1e-3  # of a caller's clock against ours, at most: one that is slewed makes half
MOST_LOST: Final = 64
MOST_KNOCKS: Final = 64
KNOCK_S: Final = 0.3  # a first call that arms nothing, and the call that does, are so far apart
WOBBLE_S: Final = 0.05  # by which their ways may differ
LET_GO: Final = "not armed any more: call with false first, then with true"
ONCE: Final = f"a single call may be an old one: go on calling, at least every {HOLD_S:g} s"


class Step(Enum):
    """Request to the daemon."""

    ARM = auto()
    RENEW = auto()
    DISARM = auto()
    NOTHING = auto()


@dataclass(frozen=True, slots=True)
class Wish:
    """One call: `armed` or not, by the caller with this GID, sent at `sent_s` by its own clock."""

    caller: bytes
    armed: bool
    sent_s: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of a call: a step with the lease that it is worth [s], or why there is none."""

    step: Step
    lease_s: float = 0.0
    why: str = ""


@dataclass(slots=True)
class Hold:
    """The caller that holds the arm armed, if any, and those that lost it and have not let go."""

    _holder: bytes | None = None
    _until_s: float = 0.0
    _offset_s: float = 0.0  # our clock before the holder's, by its fastest call
    _read_s: float = 0.0  # when that was
    _lost: deque[bytes] = field(default_factory=lambda: deque(maxlen=MOST_LOST))
    # When the first calls of those that are not heard yet were sent and came.
    _knocks: dict[bytes, tuple[float, float]] = field(default_factory=dict)

    def judge(self, wish: Wish, now_s: float) -> Verdict:
        """Verdict on a call that is looked at `now_s`."""
        if not wish.armed:
            return Verdict(Step.DISARM)
        if wish.caller == self._holder and now_s >= self._until_s:
            self.lose()
        if wish.caller == self._holder:
            late_s = self._late_s(wish.sent_s, now_s)
            if HOLD_S - late_s < LEAST_S:
                return Verdict(Step.NOTHING, why=f"{late_s:.1f} s later than its fastest call")
            return Verdict(Step.RENEW, HOLD_S - late_s)
        return self._of_another(wish, now_s)

    def _of_another(self, wish: Wish, now_s: float) -> Verdict:
        """Verdict on an armed wish of a caller that does not hold it."""
        if wish.caller in self._lost:
            return Verdict(Step.NOTHING, why=LET_GO)
        if self._holder is not None and now_s < self._until_s:
            return Verdict(Step.NOTHING, why="another client keeps it armed")
        if not self._lives(wish, now_s):
            return Verdict(Step.NOTHING, why=ONCE)
        return Verdict(Step.ARM, HOLD_S)

    def _lives(self, wish: Wish, now_s: float) -> bool:
        """True if calls arrive as far apart as they were sent. A router that hung delivers its
        backlog all at once, perhaps for a caller that has left."""
        sent_s, came_s = self._knocks.get(wish.caller, (wish.sent_s, now_s - 2.0 * HOLD_S))
        apart_s = now_s - came_s
        if apart_s > HOLD_S or abs(apart_s - (wish.sent_s - sent_s)) > WOBBLE_S:
            self._knocks.pop(wish.caller, None)
            if len(self._knocks) >= MOST_KNOCKS:
                del self._knocks[next(iter(self._knocks))]
            self._knocks[wish.caller] = (wish.sent_s, now_s)
            return False
        return apart_s >= KNOCK_S

    def granted(self, wish: Wish, lease_s: float, now_s: float) -> None:
        """Take note that the daemon carried out the verdict on an armed wish."""
        if wish.caller != self._holder:
            self.lose()
            self._holder = wish.caller
            self._knocks.pop(wish.caller, None)
            self._offset_s, self._read_s = now_s - wish.sent_s, now_s
        self._until_s = now_s + lease_s

    def lose(self) -> None:
        """Take note that the arm is not armed any more by the one that held it."""
        if self._holder is not None:
            self._lost.append(self._holder)
        self._holder = None

    def let_go(self, caller: bytes) -> None:
        """Take note that this caller let go: it may arm again. Another holder has lost it."""
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
