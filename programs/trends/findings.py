"""Findings from day records: changes of each joint since its identification, and their prognosis.

The trend of a quantity is fitted by least squares over the days since the joint's last
identification. It is reported if its change exceeds the normal variation of a gear, and is clear:
many times its standard error. Pure functions.
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
#: Least number of days with a value for a trend, and number of past days that it covers.
LEAST_DAYS, FOLLOWED_DAYS = 5, 60
AHEAD_DAYS: Final = 30
# Seconds of motion, or intervals with a gap, from which on a day counts.
_SECONDS, _LOOKS = 20.0, 0.5
# A change is clear from so many standard errors on, and from more while there are few days, as
# their scatter is then uncertain, too.
_CLEAR, _FEW = 4.0, 4.0
#: Time at a bound of the learning that is reported: seconds of a day, and share of its motion.
BOUND_S, BOUND_SHARE = 30.0, 0.2


@dataclass(frozen=True, slots=True)
class Quantity:
    """Monitored quantity: its name and format, its value and weight on a day, and which change is
    reported."""

    name: str
    label: str
    """Label of a plot's axis."""
    column: str
    """Header of a table's column."""
    unit: str
    scale: float
    """Factor to `unit`."""
    digits: int
    value: Callable[[JointDay], float]
    weight: Callable[[JointDay], float]
    least_weight: float
    share: float
    """Smallest change that is reported, relative to the initial value ..."""
    least: float
    """... and absolute."""
    error: float
    """Least standard error of a day's value."""
    bounds: tuple[float, float] = (-math.inf, math.inf)
    """Bounds of the learned value, on both sides of `around`."""
    around: float = 0.0
    relative: bool = False
    """True if a change is reported relative to the initial value."""

    def shown(self, value: float, sign: str = "") -> str:
        """Value in `unit`, as text."""
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
    """Trend of one quantity of one joint since `since`; `first` and `last`: of the fitted line."""

    what: What
    since: str
    days: int
    first: float
    last: float
    per_day: float
    large: bool
    """True if the change exceeds the normal variation of a gear."""
    errors: float
    """Ratio of the change to the one that is just clear by its standard error."""
    clear: bool
    """True if the change is large and not due to its error."""
    bound_in_days: float | None = None
    """Days until the learned value would reach its bound; None: not within AHEAD_DAYS."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointHealth:
    """Trends of one joint, and how long it was at a bound of the learning on the last day."""

    joint: str
    identified: str
    """Date of its identification; empty if it was not identified."""
    trends: tuple[Trend, ...]
    at_bound_s: float
    moved_s: float
    """Time in motion on the last day."""

    @property
    def at_bound(self) -> bool:
        """True if learned friction was at its bound for much of the last day's motion."""
        return self.at_bound_s > max(BOUND_S, BOUND_SHARE * self.moved_s)

    @property
    def named(self) -> tuple[Trend, ...]:
        """Clear trends."""
        return tuple(trend for trend in self.trends if trend.clear)

    @property
    def words(self) -> str:
        """Warning about the joint; empty if there is none."""
        parts = [_in_words(trend) for trend in self.named]
        text = ", ".join(parts)
        if self.named:
            text += f" since {_day(self.named[0].since)}"
            worn = {trend.what for trend in self.named} & {"friction", "gap"}
            text += ": identify again" + ("; grease or wear" if worn else "")
        more = [
            f"{trend.what} reaches the bound of learning in {trend.bound_in_days:.0f} days"
            for trend in self.trends
            if trend.bound_in_days is not None
        ]
        if self.at_bound:
            more = [
                f"learned friction is at its bound, for {self.at_bound_s:.0f} of the last day's "
                f"{self.moved_s:.0f} s in motion" + ("" if self.named else ": identify again")
            ]
        return "; ".join([part for part in (text, *more) if part])


def health(days: Sequence[Day]) -> tuple[JointHealth, ...]:
    """Health of each joint in the last record, from records in order; empty without records."""
    if not days:
        return ()
    last = days[-1]
    return tuple(_joint(name, days, last.identified.get(name, "")) for name in last.joints)


def warnings(days: Sequence[Day]) -> list[str]:
    """Warnings, one line for each joint that has one."""
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
    """Trends in which growing friction and gap count as clear if they are jointly significant, as a
    gear that wears shows both."""
    both = [t for t in trends if t and t.what in ("friction", "gap") and t.large and t.per_day > 0]
    together = len(both) == 2 and math.hypot(both[0].errors, both[1].errors) > 1.0
    return [replace(t, clear=True) if t and together and t in both else t for t in trends]


def _trend(what: What, followed: Sequence[tuple[str, JointDay]]) -> Trend | None:
    """Trend of one quantity; None if there are too few days."""
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
    """Days until a value with this trend reaches its bound; None if not within AHEAD_DAYS."""
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
