"""Figures of two codes' reports, held against each other, seed by seed.

The same seeds make the same arms, hands and noise, so most figures come out equal. Where rounding
differs, arms in closed loop part company after a while, as under another seed: that much of a
difference is noise. So what a figure differs by between seeds, its spread, is what it may differ by
between codes in the mean over the seeds.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

Figure = float | str | None
Kind = Literal["same", "noise", "differs"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """One figure, by seed."""

    name: str
    before: list[Figure]
    today: list[Figure]
    kind: Kind

    def __str__(self) -> str:
        return f"{self.name}: {_shown(self.before)} before, {_shown(self.today)} today"


def figures(report: Mapping[str, Any]) -> dict[str, Figure]:
    """Figures of a bench's JSON: targets by their names, data by where they stand."""
    targets = {f"target {target['name']}": target["value"] for target in report["targets"]}
    return {**_flat(targets), **_flat(report["data"])}


def _flat(value: Any, place: str = "") -> dict[str, Figure]:
    if isinstance(value, dict):
        pairs = ((str(key), one) for key, one in value.items())
    elif isinstance(value, list):
        pairs = ((str(key), one) for key, one in enumerate(value))
    elif isinstance(value, bool | str) or value is None:
        return {place: None if value is None else str(value)}
    else:
        return {place: float(value)}
    found: dict[str, Figure] = {}
    for key, one in pairs:
        found |= _flat(one, f"{place} / {key}" if place else key)
    return found


def verdicts(
    before: Sequence[Mapping[str, Figure]], today: Sequence[Mapping[str, Figure]]
) -> list[Verdict]:
    """A verdict on each figure that any report has; reports in the order of their seeds."""
    names = dict.fromkeys(name for report in (*before, *today) for name in report)
    found = []
    for name in names:
        old, new = [[r.get(name) for r in reports] for reports in (before, today)]
        found.append(Verdict(name, old, new, _kind(old, new)))
    return found


def _kind(before: Sequence[Figure], today: Sequence[Figure]) -> Kind:
    if all(_equal(a, b) for a, b in zip(before, today, strict=True)):
        return "same"
    old, new = _numbers(before), _numbers(today)
    if old is None or new is None:
        # Words, or a figure that is not always there: noise where the seed changes it, too.
        return "noise" if set(map(str, today)) <= set(map(str, before)) else "differs"
    shift = abs(statistics.fmean(b - a for a, b in zip(old, new, strict=True)))
    return "noise" if shift <= max(old) - min(old) else "differs"


def _equal(a: Figure, b: Figure) -> bool:
    if not (isinstance(a, float) and isinstance(b, float)):
        return a == b
    # Sums in another order differ in their last digits.
    return math.isclose(a, b, rel_tol=1e-9) or (math.isnan(a) and math.isnan(b))


def _numbers(values: Sequence[Figure]) -> list[float] | None:
    """The values, if all are finite numbers."""
    found = [value for value in values if isinstance(value, float) and math.isfinite(value)]
    return found if len(found) == len(values) else None


def _shown(values: Sequence[Figure]) -> str:
    return ", ".join(f"{value:.6g}" if isinstance(value, float) else str(value) for value in values)
