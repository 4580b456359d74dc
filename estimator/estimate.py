"""Result of the estimator for one tick."""

from dataclasses import dataclass
from enum import IntFlag

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.contact import Contact

SENSED_PERIODS = 2.5
"""A joint that was without a sample for longer senses nothing [periods]: its residual is old."""


class Flag(IntFlag):
    """Conditions that limit what a tick's estimate is worth."""

    INVALID = 1
    """A sample or dt was not a finite number: everything holds, the samples are not used."""
    LATE = 2
    """More than one and a half periods since the last samples of a joint; the true interval was
    used."""
    RESTARTED = 4
    """Too long without samples: residual and motor position of some joint start anew."""
    STARTING = 8
    """Not enough samples yet for a link velocity: the residual is zero."""
    RAISED = 32
    """More than one sample of a joint was missing: its levels are raised, and fade."""
    BRIDGED = 16
    """Samples of some joint are missing: its residual is the last, and the others take its link to
    go on as it did."""


@dataclass(frozen=True, slots=True)
class LearnedFriction:
    """Friction of each joint as it was learned; (n,)."""

    coulomb: Vector
    viscous: Vector
    """over the identified values"""
    load: Vector
    """Nm per Nm that the gear transmits"""
    coulomb_left: Vector
    """standard deviation of the first, over that before anything was learned"""


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
    """the residual that decides, without what was learned of friction [Nm]"""
    contacts: tuple[Contact, ...]
    """contacts that begin in this tick"""
    touched_link: str
    """joint whose link is touched; empty without a contact, and where it cannot be decided"""
    flags: Flag
    wrench: Vector
    """force at the tool (WIDTH,), as `wrench` has it: (3,) [N], its covariance, and so on"""
    sensing: NDArray[np.bool_]
    """joints whose residual is made of samples that are at most `SENSED_PERIODS` old"""


@dataclass(frozen=True, slots=True, eq=False)
class SampleRows:
    """Samples of many ticks, (ticks, n) or (ticks,), as `Estimator.step` takes those of one."""

    current: Matrix
    link_position: Matrix
    motor_velocity: Matrix
    motor_position: Matrix
    """NaN where there is none"""
    fresh: NDArray[np.bool_]
    interval_s: Vector


@dataclass(frozen=True, slots=True, eq=False)
class EstimateRows:
    """Contents of `Estimate` for many ticks: arrays of shape (ticks, n), or (ticks,)."""

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
    """index of its joint, -1 where no name is given"""
    flags: NDArray[np.int64]
    wrench: Matrix
    """(ticks, WIDTH)"""
