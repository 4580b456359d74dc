"""Detection curves over all recordings: for each level, false contacts per hour, detected touches,
and detection delays. Pure functions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add

import numpy as np

from estimator.alarms import per_hour
from programs.recordings.question import Answer, Curve


@dataclass(frozen=True, slots=True)
class Point:
    """One level of a curve."""

    level: float  # [Nm]; for the arm, the number of the step
    contacts: int
    alarms_per_hour: float  # false contacts; without labels, all contacts
    beyond: float  # fraction of the time in which a contact lasts
    found: int  # labels with a contact
    delay_p50_s: float  # NaN if none was found
    delay_p95_s: float


@dataclass(frozen=True, slots=True)
class Detection:
    """Curve of one joint, or of the arm, with the recommended point."""

    name: str
    labels: int
    points: tuple[Point, ...]
    chosen: int | None
    """Index of the lowest level with acceptable alarms; None if there is none."""


@dataclass(slots=True)
class Total:
    """Aggregate of all answers."""

    files: int = 0
    failed: list[Answer] = field(default_factory=list)
    broken: list[Answer] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)
    watched_s: float = 0.0
    outside_s: float = 0.0

    def add(self, answer: Answer) -> None:
        """Add one answer."""
        self.files += 1
        if answer.failed:
            self.failed.append(answer)
            return
        if answer.broken:
            self.broken.append(answer)
        self.answers.append(answer)
        self.watched_s += answer.watched_s
        self.outside_s += answer.outside_s

    @property
    def complete(self) -> bool:
        """True if every recording was complete and gave an answer."""
        return not (self.failed or self.broken)

    def detections(self, accepted_per_hour: float) -> list[Detection]:
        """Curves of all joints in question, and of the arm."""
        names = list(dict.fromkeys(name for answer in self.answers for name in answer.curves))
        return [self._detection(name, accepted_per_hour) for name in names]

    def _detection(self, name: str, accepted_per_hour: float) -> Detection:
        curves = [answer.curves[name] for answer in self.answers if name in answer.curves]
        curve: Curve = reduce(add, curves)
        points = tuple(self._point(curve, k) for k in range(len(curve.levels)))
        accepted = [
            k for k, point in enumerate(points) if point.alarms_per_hour <= accepted_per_hour
        ]
        return Detection(name, curve.labels, points, accepted[0] if accepted else None)

    def _point(self, curve: Curve, k: int) -> Point:
        delays: Sequence[float] = curve.delays_s[k]
        p50, p95 = np.percentile(delays, [50, 95]) if delays else (math.nan, math.nan)
        return Point(
            level=curve.levels[k],
            contacts=curve.contacts[k],
            alarms_per_hour=per_hour(curve.false[k], self.outside_s),
            beyond=curve.beyond_s[k] / self.watched_s if self.watched_s else math.nan,
            found=curve.found[k],
            delay_p50_s=float(p50),
            delay_p95_s=float(p95),
        )
