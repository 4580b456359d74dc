"""How well gaps are found without a hand, over the random joints of `gap_plants`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.report import Target
from bench.study.gap_plants import random_joint, searched
from estimator.identification.gap_result import SMALLEST
from simulator.description import SimulationSettings

TOGETHER = 25
GUESS = 0.01
"""Half-gap that every configuration guesses [rad]."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One joint: truth and what was said of it [rad], NaN without a figure."""

    half_gap: float
    observable: bool
    found: float
    confidence: float
    verdict: str
    reason: str
    lasted_s: float

    @property
    def answered(self) -> bool:
        return bool(np.isfinite(self.found))


def answers(job: tuple[int, int, int]) -> list[Answer]:
    """Search some of the joints; job: how many, a seed and the number of the job."""
    count, seed, number = job
    rng = np.random.default_rng((seed, number))
    settings = SimulationSettings(
        friction="dahl", presliding=0.0003, velocity_bias=0.0007, seed=1000 * seed + number
    )
    joints = [random_joint(rng, settings) for _ in range(count)]
    found = []
    for joint, (result, lasted_s) in zip(joints, searched(joints, GUESS, settings), strict=True):
        about = ("by hand", "gravity keeps its side within the limits")
        if result is not None:
            about = (result.verdict.value, result.reason)
        found.append(
            Answer(
                joint.half_gap,
                joint.observable,
                result.half_gap if result else np.nan,
                result.confidence if result else np.nan,
                *about,
                lasted_s,
            )
        )
    return found


def targets(found: Sequence[Answer]) -> list[Target]:
    """Targets of the project."""
    answered = [one for one in found if one.answered]
    observable = [one for one in found if one.observable]
    error = np.array([abs(one.found - one.half_gap) for one in answered])
    alpha = np.array([one.half_gap for one in answered])
    half = np.array([one.confidence for one in answered])
    share = 100.0 * sum(one.answered for one in observable) / len(observable)
    allowed = np.maximum(0.05 * alpha, 0.0005)
    wide = 2.0 * half / np.maximum(0.1 * alpha, SMALLEST)
    said = sum(bool(one.reason) for one in found if not one.answered)
    return [
        Target("observable joints answered without a hand", share, 90, "%", "higher"),
        Target("truths inside the interval", 100.0 * float((error <= half).mean()), 95, "%",
               "higher"),
        Target("interval over 10 % or 1 mrad, 95 % of answers", float(np.percentile(wide, 95.0)),
               1, "", "lower"),
        Target("error without a hand over 5 % or 0.5 mrad, 95 % of answers",
               float(np.percentile(error / allowed, 95.0)), 1, "", "lower"),
        Target(f"refusals with their cause, of {len(found) - len(answered)}", said,
               len(found) - len(answered), "", "higher"),
        Target("time of seven such joints, on average",
               7.0 * float(np.mean([one.lasted_s for one in answered])) / 60.0, 10, "min",
               "lower"),
    ]  # fmt: skip


def data(found: Sequence[Answer]) -> dict[str, Any]:
    """Numbers behind the targets, and every refusal of an observable joint."""
    refused = [one for one in found if one.observable and not one.answered]
    return {
        "joints": len(found),
        "observable": sum(one.observable for one in found),
        "answered": sum(one.answered for one in found),
        "refused": [
            {"alpha_mrad": round(1e3 * one.half_gap, 2), "why": f"{one.verdict}: {one.reason}"}
            for one in refused
        ],
    }
