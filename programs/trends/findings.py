"""Findings from day records: changes of each joint since it was identified, and where they lead.

A quantity is followed by least squares over the days since the joint was identified last. It is
named where the change over these days is larger than what a gear does by itself, and clear: many
times its standard error. Pure.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date, timedelta
from typing import Final, Literal

import numpy as np

from programs.trends.day import Day, JointDay
from programs.trends.gather import FRICTION_RANGE

What = Literal["friction", "gap", "skew", "remainder"]
#: Days with a figure below which nothing is reported of it, and how far back it is followed.
LEAST_DAYS, FOLLOWED_DAYS = 5, 60
AHEAD_DAYS: Final = 30
# Seconds of motion, or looks at the gap, that make a day count.
_SECONDS, _LOOKS = 20.0, 0.5
# A change is clear from so many standard errors on, and more of them while the days are few: their
# scatter is not known well either.
_CLEAR, _FEW = 4.0, 4.0
#: Time at a bound of the learning that is reported: seconds of a day, and share of its motion.
BOUND_S, BOUND_SHARE = 30.0, 0.2


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity that is followed: its name and how it is shown, its value of a day, and weight;
    what change of it counts."""

    name: str
    label: str
    """of an axis"""
    column: str
    """of a table"""
    unit: str
    scale: float
    """to this unit"""
    digits: int
    value: Callable[[JointDay], float]
    weight: Callable[[JointDay], float]
    least_weight: float
    share: float
    """smallest change that is named, of the value it began with ..."""
    least: float
    """... and by itself"""
    error: float
    """of a day's value, at least"""
    bounds: tuple[float, float] = (-math.inf, math.inf)
    """of what is learned, on both sides of `around`"""
    around: float = 0.0
    relative: bool = False
    """A change is said as a share of the value it began with"""

    def shown(self, value: float, sign: str = "") -> str:
        """Value in its unit."""
        return f"{self.scale * value:{sign}.{self.digits}f} {self.unit}"


QUANTITIES: Final[dict[What, Quantity]] = {
    "friction": Quantity(
        "friction", "friction [% of the configuration's]", "friction", "%", 100.0, 0,
        lambda d: d.friction.mean, lambda d: d.friction.weight, _SECONDS, 0.08, 0.05, 0.01,
        FRICTION_RANGE, 1.0, relative=True,
    ),
    "gap": Quantity(
        "gap", "half-gap [mrad]", "gap", "mrad", 1000.0, 1,
        lambda d: d.half_gap.mean, lambda d: d.half_gap.weight, _LOOKS, 0.12, 3e-4, 5e-5,
    ),
    "skew": Quantity(
        "encoder skew", "encoder skew [ms]", "skew", "ms", 1.0, 1,
        lambda d: d.skew_ms.mean, lambda d: d.skew_ms.weight, _LOOKS, 0.0, 1.0, 0.1,
    ),
    "remainder": Quantity(
        "gravity's remainder", "gravity's remainder [Nm]", "gravity", "Nm", 1.0, 2,
        lambda d: d.remainder, lambda d: min(d.forth.weight, d.back.weight), _SECONDS, 0.0, 0.15,
        0.01,
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """One quantity of one joint since `since`; `first` and `last` are of the fitted line."""

    what: What
    since: str
    days: int
    first: float
    last: float
    per_day: float
    large: bool
    """larger than what a gear does by itself"""
    errors: float
    """change over what of it would just be clear; of its error alone"""
    clear: bool
    """large, and not its error"""
    bound_in_days: float | None = None
    """until what is learned of it is at its bound, if it goes on so; None: not within a month"""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointHealth:
    """One joint: its trends, and how long it was at a bound of the learning on the last day."""

    joint: str
    identified: str
    """date of its identification, empty where it was not"""
    trends: tuple[Trend, ...]
    at_bound_s: float
    moved_s: float
    """in which it moved, on the last day"""

    @property
    def at_bound(self) -> bool:
        """True if what is learned of it was at its bound for much of the last day."""
        return self.at_bound_s > max(BOUND_S, BOUND_SHARE * self.moved_s)

    @property
    def named(self) -> tuple[Trend, ...]:
        """Trends that are clear."""
        return tuple(trend for trend in self.trends if trend.clear)

    @property
    def words(self) -> str:
        """Warning about it; empty where there is none."""
        parts = [_in_words(trend) for trend in self.named]
        text = ", ".join(parts)
        if self.named:
            text += f" since {_day(self.named[0].since)}"
            worn = {trend.what for trend in self.named} & {"friction", "gap"}
            text += ": identify again" + ("; grease or wear" if worn else "")
        more = [
            f"{trend.what} reaches the bound of what is learned in {trend.bound_in_days:.0f} days"
            for trend in self.trends
            if trend.bound_in_days is not None
        ]
        if self.at_bound:
            more = [
                f"what is learned is at its bound, for {self.at_bound_s:.0f} of the last day's "
                f"{self.moved_s:.0f} s in motion" + ("" if self.named else ": identify again")
            ]
        return "; ".join([part for part in (text, *more) if part])


def health(days: Sequence[Day]) -> tuple[JointHealth, ...]:
    """Health of each joint of the last day's record, from records in order; empty without any."""
    if not days:
        return ()
    last = days[-1]
    return tuple(_joint(name, days, last.identified.get(name, "")) for name in last.joints)


def warnings(days: Sequence[Day]) -> list[str]:
    """Warnings, a line for each joint that has one."""
    return [f"{one.joint}: {one.words}" for one in health(days) if one.words]


def _joint(name: str, days: Sequence[Day], identified: str) -> JointHealth:
    last = date.fromisoformat(days[-1].date)
    from_on = max(identified[:10], (last - timedelta(days=FOLLOWED_DAYS)).isoformat())
    followed = [(day.date, day.joints[name]) for day in days
                if day.date >= from_on and name in day.joints]  # fmt: skip
    trends = _worn([_trend(what, followed) for what in QUANTITIES])
    return JointHealth(
        joint=name,
        identified=identified[:10],
        trends=tuple(trend for trend in trends if trend is not None),
        at_bound_s=days[-1].joints[name].bound_s,
        moved_s=days[-1].joints[name].moved_s,
    )


def _worn(trends: Sequence[Trend | None]) -> list[Trend | None]:
    """The same, with friction and gap both clear where both grow and are so together: a gear that
    wears shows both."""
    both = [t for t in trends if t and t.what in ("friction", "gap") and t.large and t.per_day > 0]
    together = len(both) == 2 and math.hypot(both[0].errors, both[1].errors) > 1.0
    return [replace(t, clear=True) if t and together and t in both else t for t in trends]


def _trend(what: What, followed: Sequence[tuple[str, JointDay]]) -> Trend | None:
    """Trend of one quantity; None where there are too few days."""
    q = QUANTITIES[what]
    rows = [
        (date.fromisoformat(at).toordinal(), q.value(day))
        for at, day in followed
        if q.weight(day) > q.least_weight and math.isfinite(q.value(day))
    ]
    if len(rows) < LEAST_DAYS:
        return None
    at, y = np.array(rows, dtype=np.float64).T
    t = at - at[0]
    slope, middle = np.polyfit(t - t.mean(), y, 1)
    left = y - middle - slope * (t - t.mean())
    scatter = max(float(np.sqrt(left @ left / (len(y) - 2))), q.error)
    per_day, span = float(slope), float(t[-1])
    first = float(middle - slope * t.mean())
    error = scatter / float(np.sqrt(np.sum((t - t.mean()) ** 2)))
    change = per_day * span
    large = abs(change) > max(q.share * abs(first), q.least)
    errors = abs(per_day) / (_CLEAR * (1.0 + _FEW / (len(y) - 2)) * error)
    clear = large and errors > 1.0
    return Trend(
        what=what,
        since=date.fromordinal(round(at[0])).isoformat(),
        days=len(y),
        first=first,
        last=first + change,
        per_day=per_day,
        large=large,
        errors=errors,
        clear=clear,
        bound_in_days=_until_bound(q, first + change, per_day) if clear else None,
    )


def _until_bound(q: Quantity, value: float, per_day: float) -> float | None:
    """Days until a value that goes on so is at its bound; None where it is not within a month."""
    if per_day * (value - q.around) <= 0.0:
        return None
    days = max((q.bounds[per_day > 0.0] - value) / per_day, 0.0)
    return days if days <= AHEAD_DAYS else None


def _in_words(trend: Trend) -> str:
    q, change = QUANTITIES[trend.what], trend.last - trend.first
    return f"{q.name} {q.shown(change / max(trend.first, 0.1) if q.relative else change, '+')}"


def _day(iso: str) -> str:
    day = date.fromisoformat(iso)
    return f"{day.day} {day.strftime('%B')}"
