"""Estimates for a whole recording, as arrays, including the residuals that run side by side."""

from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from bench.rigs.arm_without_bus import Recording
from bench.study.rivals import KALMAN, KALMAN_BELIEF, kalman
from common.arrays import Matrix
from daemon.assembly import build_estimator
from daemon.config.load import Robot
from estimator.estimate import EstimateRows, SampleRows
from estimator.estimator import Estimator
from estimator.settings import Variant

VARIANTS: Final = (
    Variant(),
    Variant(kind="classical", friction=False, rotor_inertia=False, label="classical"),
    Variant(kind="classical", friction=True, rotor_inertia=False, label="classical+friction"),
    Variant(kind="classical", friction=True, rotor_inertia=True, label="classical+friction+rotor"),
    Variant(kind="backlash", rotor_inertia=False, label="backlash-rotor"),
    Variant(kind="two_mass", label="two_mass"),
)
"""All residuals that are compared, whichever one decides in the configuration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimates:
    """Estimates, one row per SYNC, true `delay_s` before it."""

    residuals: dict[str, Matrix]  # by variant, the one that decides first, Kalman last [Nm]
    threshold: Matrix  # in force, with its raise near rest [Nm]
    side: NDArray[np.int8]
    delay_s: float


def build(robot: Robot, **changes: object) -> Estimator:
    """Estimator of the robot's configuration, with all VARIANTS side by side; `changes` apply to
    its EstimatorSettings."""
    c = robot.configuration
    beside = tuple(v for v in VARIANTS if v.name != c.estimator.residual.name)
    settings = msgspec.structs.replace(c.estimator, **{"beside": beside, **changes})
    return build_estimator(msgspec.structs.replace(c, estimator=settings), robot.model)


def rows_of(estimator: Estimator, samples: Matrix) -> EstimateRows:
    """Estimates for samples (ticks, 4, n) without gaps: current, link position, motor velocity and
    position. The estimator continues from its present state."""
    current, link_position, motor_velocity, motor_position = np.moveaxis(samples, 1, 0)
    return estimator.run(
        SampleRows(
            current=current, link_position=link_position, motor_velocity=motor_velocity,
            motor_position=motor_position, fresh=np.ones(current.shape, dtype=np.bool_),
            interval_s=np.full(len(current), estimator.period_s),
        )
    )  # fmt: skip


def estimates(estimator: Estimator, recording: Recording) -> Estimates:
    """Estimates of a recording; the estimator continues from its present state."""
    rows = rows_of(estimator, recording.samples)
    residuals = {estimator.variants[0].name: rows.residual, **rows.beside}
    if KALMAN_BELIEF in residuals:
        belief, K = residuals[KALMAN_BELIEF], estimator.settings.gain
        residuals[KALMAN] = kalman(belief, K, estimator.period_s)
    return Estimates(
        residuals=residuals, threshold=rows.threshold, side=rows.side, delay_s=estimator.delay_s
    )
