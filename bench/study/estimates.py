"""Estimates for a whole recording, as arrays, with the residuals that run side by side."""

from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from arrays import Matrix
from bench.contact_free import BESIDE
from bench.rigs.arm_without_bus import Recording
from bench.study.rivals import KALMAN, KALMAN_BELIEF, kalman
from daemon.assembly import build_estimator
from daemon.config.load import Robot
from estimator.estimator import Estimator
from estimator.settings import Variant

VARIANTS: Final = (Variant(), *BESIDE)
"""Every residual that is compared, whichever of them the configuration lets decide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimates:
    """One row per SYNC, true `delay_s` before it."""

    residuals: dict[str, Matrix]
    """by the name of the variant, the one that decides first, the Kalman rival last [Nm]"""
    threshold: Matrix
    """in force, with its raise near rest [Nm]"""
    phi: Matrix
    phi_sigma: Matrix
    side: NDArray[np.int8]
    touched_link: NDArray[np.int64]
    """(ticks,): index of the joint whose link is said to be touched, -1 where none is"""
    delay_s: float


def build(robot: Robot, **changes: object) -> Estimator:
    """The estimator of the robot's configuration, with all VARIANTS side by side; `changes` go to
    its EstimatorSettings."""
    c = robot.configuration
    beside = tuple(v for v in VARIANTS if v.name != c.estimator.residual.name)
    settings = msgspec.structs.replace(c.estimator, **{"beside": beside, **changes})
    return build_estimator(msgspec.structs.replace(c, estimator=settings), robot.urdf)


def estimates(estimator: Estimator, recording: Recording) -> Estimates:
    """Step through the recording; the estimator goes on from where it was."""
    shape = recording.samples.shape[0], recording.samples.shape[2]
    names = [variant.name for variant in estimator.variants]
    residuals = {name: np.empty(shape) for name in names}
    threshold, phi, phi_sigma = np.empty((3, *shape))
    side = np.empty(shape, dtype=np.int8)
    touched_link = np.full(len(recording.samples), -1)
    row_of = {name: i for i, name in enumerate(estimator.model.names)}
    for k, (current, link_position, motor_velocity, motor_position) in enumerate(recording.samples):
        e = estimator.step(current, link_position, motor_velocity, motor_position)
        residuals[names[0]][k] = e.residual
        for name, r in e.beside.items():
            residuals[name][k] = r
        touched_link[k] = row_of.get(e.touched_link, -1)
        threshold[k], phi[k], phi_sigma[k], side[k] = e.threshold, e.phi, e.phi_sigma, e.side
    if KALMAN_BELIEF in residuals:
        belief, K = residuals[KALMAN_BELIEF], estimator.settings.gain
        residuals[KALMAN] = kalman(belief, K, estimator.period_s)
    return Estimates(
        residuals=residuals,
        threshold=threshold,
        phi=phi,
        phi_sigma=phi_sigma,
        side=side,
        touched_link=touched_link,
        delay_s=estimator.delay_s,
    )
