"""Result of the estimator for one tick."""

from dataclasses import dataclass
from enum import IntFlag

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.contact import Contact

SENSED_PERIODS = 2.5
"""Age of its last sample beyond which a joint senses nothing [periods], as its residual is old."""


class Flag(IntFlag):
    """Conditions that limit the validity of a tick's estimate."""

    INVALID = 1
    """A sample or dt was not finite: all values are held, and the samples are not used."""
    LATE = 2
    """More than 1.5 periods since the previous samples of a joint; the true interval was used."""
    RESTARTED = 4
    """Too long without samples: residual and motor position of some joint restart."""
    STARTING = 8
    """Not enough samples yet for a link velocity: the residual is zero."""
    RAISED = 32
    """More than one sample of a joint was missing: its levels are raised for a moment."""
    BRIDGED = 16
    """Samples of some joint are missing: it keeps its last residual, and its link motion is
    extrapolated for the others."""


@dataclass(frozen=True, slots=True)
class LearnedFriction:
    """Learned friction of each joint; (n,)."""

    coulomb: Vector
    viscous: Vector
    """both relative to the identified values"""
    load: Vector
    """friction per torque that the gear transmits [Nm/Nm]"""
    coulomb_left: Vector
    """standard deviation of `coulomb`, relative to that before anything was learned"""


class Estimate(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Result of one tick; arrays of shape (n,), never changed afterwards."""

    q: Vector
    """link position at the common instant [rad]"""
    q_dot: Vector
    """link velocity [rad/s]"""
    theta: Vector
    """motor position at the link side [rad]"""
    phi: Vector
    """q - theta [rad]"""
    phi_sigma: Vector
    """standard uncertainty of phi [rad]"""
    side: NDArray[np.int8]
    """`motor_position.Side`"""
    tau_M: Vector
    """K_c * current [Nm]"""
    residual: Vector
    """estimate of the external torque by the residual that decides [Nm]"""
    beside: dict[str, Vector]
    """other residuals on the same samples [Nm]"""
    threshold: Vector
    """contact threshold in force [Nm]"""
    thresholded: Vector
    """sign(r) max(|r| - threshold, 0) [Nm]"""
    level_share: Vector
    """k: share of the configured contact level that learning leaves in force"""
    uncorrected: Vector
    """the residual that decides, without the correction by learned friction [Nm]"""
    contacts: tuple[Contact, ...]
    """contacts that begin in this tick"""
    touched_link: str
    """joint whose link is touched; empty without a contact, or if undecidable"""
    flags: Flag
    wrench: Vector
    """force at the tool (WIDTH,), laid out as in `wrench`: (3,) [N], its covariance, and so on"""
    sensing: NDArray[np.bool_]
    """joints whose residual is based on samples at most `SENSED_PERIODS` old"""


@dataclass(frozen=True, slots=True, eq=False)
class SampleRows:
    """Samples of many ticks, (ticks, n) or (ticks,): each row as `Estimator.step` takes it."""

    current: Matrix
    link_position: Matrix
    motor_velocity: Matrix
    motor_position: Matrix
    """NaN where there is none"""
    fresh: NDArray[np.bool_]
    interval_s: Vector


@dataclass(frozen=True, slots=True, eq=False)
class EstimateRows:
    """Fields of `Estimate` for many ticks: arrays of shape (ticks, n), or (ticks,)."""

    q: Matrix
    q_dot: Matrix
    theta: Matrix
    phi: Matrix
    phi_sigma: Matrix
    tau_M: Matrix
    threshold: Matrix
    thresholded: Matrix
    level_share: Matrix
    uncorrected: Matrix
    side: NDArray[np.int8]
    residual: Matrix
    beside: dict[str, Matrix]
    touched_link: NDArray[np.int64]
    """index of its joint, -1 without one"""
    flags: NDArray[np.int64]
    wrench: Matrix
    """(ticks, WIDTH)"""
