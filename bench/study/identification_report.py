"""Report of `bench.identification` for people."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from common.arrays import Vector


def allowed_of_gap(true_half_gap: Vector) -> Vector:
    """5 %, or 0.5 mrad where that is more [rad]."""
    return np.asarray(np.maximum(0.05 * true_half_gap, 0.0005))


def summary(errors: Vector) -> dict[str, list[float | None]]:
    """Summary of errors (arms, n), per joint: median and 95th percentile of their sizes, None where
    no arm has an answer, and the share of arms without one."""
    size = [np.abs(column[~np.isnan(column)]) for column in errors.T]
    return {
        "median": [round(float(np.median(x)), 3) if len(x) else None for x in size],
        "p95": [round(float(np.percentile(x, 95.0)), 3) if len(x) else None for x in size],
        "unanswered": np.isnan(errors).mean(axis=0).round(3).tolist(),
    }


def lines(data: dict[str, Any]) -> Iterator[str]:
    """A block for each case, a line for each coefficient."""

    def row(name: str, one: dict[str, list[float | None]]) -> str:
        pairs = zip(one["median"], one["p95"], strict=True)
        cells = (f"{m:.2f}/{p:.2f}" if m is not None else "-" for m, p in pairs)
        return f"  {name:14}" + "".join(f"{cell:>13}" for cell in cells)

    heads = "".join(f"{i:>13}" for i in range(1, len(data["joints"]) + 1))
    for case, by_coefficient in data["errors_percent"].items():
        yield f"\n{case}: size of the errors over {data['arms']} arms, median/95 %"
        yield f"  {'joint':14}{heads}"
        yield from (row(f"{name} [%]", one) for name, one in by_coefficient.items())
    yield "\na hand at each link"
    yield row("alpha [mrad]", data["half_gap_mrad"])
