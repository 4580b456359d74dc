"""Classification of contacts: what kind each was, and where, from its course.

The rules are fixed: WORDS is a table, whose first matching row applies.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from math import inf
from typing import Any, Final

import numpy as np

from common.arrays import Vector
from daemon.modes.table import SENSING, YIELDING
from daemon.protocol.state import Snapshot, State
from programs.recordings.touch_point import TouchFinder, TouchPoint, touch_words

APART_S, STAYS = 0.3, 0.5
"""Quiet time that ends a contact, as an arm swings through its gaps [s]. Quiet: below the level,
and below this share of its largest residual, as levels rise when an arm stops."""
LEANS_S, STEADY, HELD_S, HELD_RAD, PUSHED_S, PUSHED_RAD = 2.0, 0.2, 0.5, 0.005, 0.4, 0.02
_HARD_S: Final = 0.15


@dataclass(slots=True)
class Evidence:
    """Evidence of one contact."""

    begin_s: float
    seconds: float = 0.0  # above its level, with dips that stay above the level at its peak
    hard: bool = False  # exceeded a collision level within _HARD_S
    held_s: float = 0.0  # a yielding arm did not move, although pressed above its levels
    harder: float = 0.0  # relative increase when the arm moved on
    moved_rad: float = 0.0  # largest displacement of a joint while the arm yields
    unsteady: float = 0.0  # spread over mean of the largest residual during the last second
    load_kg: float | None = None  # recognised load, while the arm does not yield
    most_N: float = 0.0
    where: TouchPoint | None = None  # the latest of the best-known points


WORDS: Final[dict[str, tuple[Callable[[Evidence], bool], str]]] = {
    "load": (lambda e: e.load_kg is not None, "it is what an unannounced load weighs"),
    "clamped": (
        lambda e: e.held_s >= HELD_S or e.harder >= STEADY,
        "pressed and does not move, or harder as soon as the arm goes on",
    ),
    "hit": (lambda e: e.hard, "above a collision level at once"),
    "leaning": (lambda e: e.seconds >= LEANS_S and e.unsteady <= STEADY, "long and steady"),
    "pushed": (
        lambda e: e.seconds >= PUSHED_S or e.moved_rad >= PUSHED_RAD,
        "longer, or it gave way",
    ),
    "touched": (lambda _: True, "short, and nothing moved"),
}
"""Kinds of contact, each with its predicate and its reason in words."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact that has ended, or is still present, with its kind."""

    word: str
    evidence: Evidence

    @classmethod
    def of(cls, evidence: Evidence) -> "Contact":
        """Contact with this evidence, classified by the first matching row of WORDS."""
        return cls(next(word for word, (holds, _) in WORDS.items() if holds(evidence)), evidence)

    def report(self) -> dict[str, Any]:
        """Object that `contactctl --json touches` prints."""
        e, at = self.evidence, self.evidence.where
        return {
            "word": self.word,
            "why": WORDS[self.word][1],
            **{k: round(getattr(e, k), 3) for k in ("begin_s", "seconds", "moved_rad", "most_N")},
            "joints": list(at.joints) if at else [],
            "decided": bool(at and at.decided),
            "link": at.link if at else "",
            "point_m": np.round(at.point, 3).tolist() if at and at.placed else None,
            "doubt_m": round(at.doubt_m, 3) if at and at.placed else None,
        }

    def __str__(self) -> str:
        e = self.evidence
        place = touch_words(e.where) if e.where else "where is not known"
        moved = f", moved {e.moved_rad:.2f} rad" if e.moved_rad >= PUSHED_RAD else ""
        newtons = f", up to {e.most_N:.0f} N" if e.most_N else ""
        why = WORDS[self.word][1]
        return f"{self.word} ({why}): {place}; {e.seconds:.2f} s{newtons}{moved}"


class Touches:
    """Detector of the contacts of one arm; `take` each State."""

    def __init__(self, snapshot: Snapshot) -> None:
        """Create a detector. Raises ModelError for an invalid URDF."""
        self._finder = TouchFinder.of(snapshot)
        self.now: Evidence | None = None  # of the present contact
        self._time_s, self._last_s, self._held_from_s = inf, 0.0, 0.0
        self._begun_at = self._held_at = np.zeros(0)
        # Joint with the largest residual above its level, that residual, the level at that time,
        # and the residual before the arm moved on.
        self._joint, self._peak, self._level, self._rested = 0, 0.0, 0.0, 0.0
        self._waits_s = 0.0  # above that level, but not above the one in force
        self._sizes: list[tuple[float, float]] = []

    def take(self, state: State) -> Contact | None:
        """Contact that has ended with this State, or None."""
        q, r = (np.array(part, dtype=np.float64) for part in (state.link_position, state.residual))
        senses = state.mode in SENSING and (state.sensing is None or np.array(state.sensing))
        r = np.where(senses, r, np.nan)
        found, now = self._finder.see(state), self.now
        since = max(state.time_s - self._time_s, state.interval_s)
        self._time_s = state.time_s
        stays = now is not None and abs(r[self._joint]) > STAYS * self._peak
        if found is None and not stays:
            if now is None or state.time_s - self._last_s <= APART_S:
                return None
            ended, self.now = Contact.of(now), None
            return ended
        if now is None:
            now = self.now = Evidence(state.time_s)
            self._begun_at, self._held_at, self._held_from_s = q, q, state.time_s
            self._sizes, self._peak, self._rested, self._waits_s = [], 0.0, 0.0, 0.0
        self._last_s = state.time_s
        self._see(now, state, found, q, r)
        self._waits_s = self._waits_s + since if abs(r[self._joint]) > self._level else 0.0
        if found is not None:
            now.seconds, self._waits_s = now.seconds + max(self._waits_s, since), 0.0
        return None

    def _see(
        self, e: Evidence, state: State, found: TouchPoint | None, q: Vector, r: Vector
    ) -> None:
        levels = [notice.contact.level for notice in state.notices if notice.contact]
        e.hard |= "collision" in levels and e.seconds <= _HARD_S
        yields = state.mode in YIELDING
        if found is not None:  # a load that explains all residuals is no contact of a hand
            e.load_kg = state.recognised.mass if state.recognised and not yields else None
        if not yields:
            self._begun_at = q
        e.moved_rad = max(e.moved_rad, float(np.abs(q - self._begun_at).max()))
        if np.abs(q - self._held_at).max() > HELD_RAD or not yields or found is None:
            self._held_at, self._held_from_s = q, state.time_s
        e.held_s = max(e.held_s, state.time_s - self._held_from_s)
        beyond = np.where(np.abs(r) > state.threshold, np.abs(r), 0.0)
        if found is not None and beyond.max() > self._peak:
            self._joint, self._peak = int(beyond.argmax()), float(beyond.max())
            self._level = state.threshold[self._joint]
        size = float(abs(r[self._joint]))
        if found is None and yields:
            self._rested = size
        elif found is not None and self._rested > 0.0:
            e.harder = max(e.harder, size / self._rested - 1.0)
        self._sizes = [one for one in self._sizes if state.time_s - one[0] < 1.0]
        self._sizes.append((state.time_s, size))
        if found is None:
            return
        sizes = np.array([one for _, one in self._sizes])
        e.unsteady = float(sizes.std() / sizes.mean())
        if e.where is None or _known(found) >= _known(e.where):
            e.where = found
        e.most_N = max(e.most_N, float(np.linalg.norm(found.force)) if found.placed else 0.0)


def contacts(messages: Iterable[Snapshot | State]) -> Iterator[Contact]:
    """Contacts as they end, and one that is present at the end; the first message must be a
    Snapshot. Raises ModelError."""
    seen: Touches | None = None
    for message in messages:
        if isinstance(message, Snapshot):
            seen = seen or Touches(message)
        elif seen is not None and (contact := seen.take(message)):
            yield contact
    if seen is not None and seen.now is not None:
        yield Contact.of(seen.now)


def _known(found: TouchPoint) -> tuple[bool, bool]:
    return found.decided, found.placed
