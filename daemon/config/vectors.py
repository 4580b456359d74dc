"""Configuration values as arrays over the joints, and as settings of the motion."""

from collections.abc import Callable

import numpy as np

from common.arrays import Vector
from daemon.config.schema import Configuration, Joint
from daemon.motion.limits import Limits
from daemon.motion.target_stream import StreamSettings
from daemon.protocol.guide import GuideAxes


def row(c: Configuration, of: Callable[[Joint], float]) -> Vector:
    """Vector (n,) with one value per joint."""
    return np.array([of(joint) for joint in c.joints], dtype=np.float64)


def virtual_mass_of(c: Configuration) -> Vector:
    """Virtual mass (n,) as a time constant [s]: the joint's own, or that of `admittance`."""
    usual = c.admittance.virtual_mass_s
    return row(c, lambda j: usual if j.virtual_mass_s is None else j.virtual_mass_s)


def limits_of(c: Configuration) -> Limits:
    """Limits of every setpoint."""
    return Limits(
        lower=row(c, lambda j: j.limits.lower),
        upper=row(c, lambda j: j.limits.upper),
        velocity=row(c, lambda j: j.limits.velocity),
        acceleration=row(c, lambda j: j.limits.acceleration),
        # A setpoint is latched by the next SYNC and approached over the period after that.
        reaction_s=1.5 * c.period_s + c.control.drive_lag_ms / 1000.0,
        tolerance=c.supervisor.position_margin,
    )


def stream_settings_of(c: Configuration) -> StreamSettings:
    """Behaviour of streams of targets."""
    return StreamSettings(c.stream.after_contact, c.stream.reach, c.stream.join_velocity)


def guide_of(c: Configuration) -> GuideAxes:
    """Axes of the guide for an arm that is led by hand."""
    a = c.admittance
    return GuideAxes(
        frame=a.frame, free=a.free, damped=a.damped, held=a.held, stiff=a.stiff,
        redundant=a.redundant,
    )  # fmt: skip
