"""Contacts in words that a program can use: what each was, of how it went, and where.

Nothing is learned: WORDS is the table, the first that holds is said, with the evidence it needs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from common.arrays import Vector
from daemon.modes.table import Mode
from daemon.protocol.state import Snapshot, State
from programs.recordings.touch_point import TouchFinder, TouchPoint, touch_words

APART_S, STAYS = 0.3, 0.5
"""Quiet time that ends a contact, as an arm swings through its gaps [s]; quiet is below its level
and this share of its largest residual: levels rise where an arm stops."""
LEANS_S, STEADY, HELD_S, HELD_RAD, PUSHED_S, PUSHED_RAD = 2.0, 0.2, 0.5, 0.005, 0.4, 0.02
_HARD_S: Final = 0.15


@dataclass(slots=True)
class Evidence:
    """Evidence of one contact."""

    begin_s: float
    seconds: float = 0.0
    hard: bool = False  # past a collision level within _HARD_S
    held_s: float = 0.0  # an arm that yields did not move, though pressed beyond its levels
    harder: float = 0.0  # by this share, when the arm went on
    moved_rad: float = 0.0  # of the joint that moved furthest
    unsteady: float = 0.0  # of the strongest residual, the last second: spread over mean
    load_kg: float | None = None  # recognised
    most_N: float = 0.0
    where: TouchPoint | None = None  # the last of those that are best known


WORDS: Final[dict[str, tuple[Callable[[Evidence], bool], str]]] = {
    "load": (lambda e: e.load_kg is not None, "it weighs what an unannounced load would"),
    "clamped": (
        lambda e: e.held_s >= HELD_S or e.harder >= STEADY,
        "pressed and does not move, or harder as soon as the arm goes on",
    ),
    "hit": (lambda e: e.hard, "past a collision level at once"),
    "leaning": (lambda e: e.seconds >= LEANS_S and e.unsteady <= STEADY, "long and steady"),
    "pushed": (lambda e: e.seconds >= PUSHED_S or e.moved_rad >= PUSHED_RAD, "it gave way"),
    "touched": (lambda _: True, "short, and nothing moved"),
}
"""Each word, whether a contact is one, and why in words."""


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact that is over, or still going on."""

    word: str
    evidence: Evidence

    @classmethod
    def of(cls, evidence: Evidence) -> "Contact":
        """The contact of this evidence, by the first word that holds."""
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
    """Contacts of one arm; `take` each State."""

    def __init__(self, snapshot: Snapshot) -> None:
        """Raises ModelError for a bad URDF."""
        self._finder = TouchFinder.of(snapshot)
        self._now: Evidence | None = None
        self._last_s = self._held_from_s = 0.0
        self._begun_at = self._held_at = np.zeros(0)
        # Joint whose residual is the largest, that, and what it was before the arm went on.
        self._joint, self._peak, self._rested = 0, 0.0, 0.0
        self._sizes: list[tuple[float, float]] = []

    def take(self, state: State) -> Contact | None:
        """The contact that has ended with this State, if one has."""
        q, r = (np.array(part, dtype=np.float64) for part in (state.link_position, state.residual))
        if state.sensing is not None:
            r = np.where(state.sensing, r, np.nan)
        found = self._finder.see(state)
        stays = self._now is not None and abs(r[self._joint]) > STAYS * self._peak
        if found is None and not stays:
            if self._now is None or state.time_s - self._last_s <= APART_S:
                return None
            ended, self._now = Contact.of(self._now), None
            return ended
        if self._now is None:
            self._now = Evidence(state.time_s)
            self._begun_at, self._held_at, self._held_from_s = q, q, state.time_s
            self._sizes, self._peak, self._rested = [], 0.0, 0.0
        self._last_s = state.time_s
        self._see(self._now, state, found, q, r)
        return None

    def _see(
        self, e: Evidence, state: State, found: TouchPoint | None, q: Vector, r: Vector
    ) -> None:
        e.seconds = state.time_s - e.begin_s
        levels = [notice.contact.level for notice in state.notices if notice.contact]
        e.hard |= "collision" in levels and e.seconds <= _HARD_S
        e.load_kg = state.recognised.mass if state.recognised else e.load_kg
        e.moved_rad = max(e.moved_rad, float(np.abs(q - self._begun_at).max()))
        yields = state.mode == Mode.ADMITTANCE
        if np.abs(q - self._held_at).max() > HELD_RAD or not yields or found is None:
            self._held_at, self._held_from_s = q, state.time_s
        e.held_s = max(e.held_s, state.time_s - self._held_from_s)
        if found is not None and np.nanmax(np.abs(r)) > self._peak:
            self._joint = int(np.nanargmax(np.abs(r)))
            self._peak = float(abs(r[self._joint]))
        size = float(abs(r[self._joint]))
        if found is None and yields:
            self._rested = size
        elif found is not None and self._rested > 0.0:
            e.harder = max(e.harder, size / self._rested - 1.0)
        self._sizes = [one for one in self._sizes if state.time_s - one[0] < 1.0]
        self._sizes.append((state.time_s, size))
        sizes = np.array([one for _, one in self._sizes])
        e.unsteady = float(sizes.std() / sizes.mean())
        if found is None:
            return
        if e.where is None or _known(found) >= _known(e.where):
            e.where = found
        e.most_N = max(e.most_N, float(np.linalg.norm(found.force)) if found.placed else 0.0)


def _known(found: TouchPoint) -> tuple[bool, bool]:
    return found.decided, found.placed
