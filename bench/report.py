"""Report of a bench: targets with their measured figures, as text or as one JSON line."""

import json
import math
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import click
import numpy as np
import yaml

from common.arrays import Matrix


@dataclass(frozen=True, slots=True)
class Target:
    """A figure and the limit it is held against."""

    name: str
    value: float
    limit: float
    unit: str = ""
    better: Literal["lower", "higher"] = "lower"

    @property
    def met(self) -> bool:
        """True where the figure is on the good side of its limit; NaN, nothing measured, is not."""
        value = float(self.value)  # a numpy number would give a numpy bool, which JSON lacks
        return value <= self.limit if self.better == "lower" else value >= self.limit


def summary(errors: Matrix) -> dict[str, list[float | None]]:
    """Summary of errors (arms, n), per joint: median and 95th percentile of their sizes, None where
    no arm has an answer, and the share of arms without one."""
    size = [np.abs(column[~np.isnan(column)]) for column in errors.T]
    return {
        "median": [round(float(np.median(x)), 3) if len(x) else None for x in size],
        "p95": [round(float(np.percentile(x, 95.0)), 3) if len(x) else None for x in size],
        "unanswered": np.isnan(errors).mean(axis=0).round(3).tolist(),
    }


def plain(value: Any, digits: int | None = None) -> Any:
    """Value fit for JSON: lists for arrays, None for what is no number, decimals cut."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, dict):
        return {key: plain(each, digits) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each, digits) for each in value]
    if isinstance(value, float):
        rounded = value if digits is None else round(value, digits)
        return rounded if math.isfinite(value) else None
    return value


def print_report(
    bench: str, seed: int, targets: Sequence[Target], data: dict[str, Any], *, as_json: bool
) -> None:
    """Data in YAML to four decimals and targets as lines, or everything as one object in JSON."""
    if as_json:
        rows = [asdict(target) | {"met": target.met} for target in targets]
        machine = f"{platform.machine()} {platform.python_version()}"
        report = {"bench": bench, "seed": seed, "machine": machine, "targets": rows, "data": data}
        click.echo(json.dumps(plain(report)))
        return
    if data:
        as_plain = json.loads(json.dumps(plain(data, 4)))
        click.echo(yaml.safe_dump(as_plain, sort_keys=False, default_flow_style=None))
    for target in targets:
        sign = "<=" if target.better == "lower" else ">="
        met = "met" if target.met else "NOT MET"
        measured = f"{target.value:.4g} {target.unit}"
        if math.isnan(target.value):
            measured = "too few trials to tell"
        click.echo(f"  {target.name}: {measured} ({sign} {target.limit:g}) {met}")
