"""Limits and trajectories of a configuration, as arrays and paths."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from common.arrays import Vector
from common.errors import TrajectoryError
from daemon.config.schema import Configuration, Joint
from daemon.motion.limits import Limits
from daemon.motion.path import Sinusoids
from daemon.motion.sampled_path import PathBuilder, SampledPath
from daemon.motion.target_stream import StreamSettings
from daemon.motion.trajectory_file import read_trajectory
from daemon.protocol.guide import GuideAxes


def row(c: Configuration, of: Callable[[Joint], float]) -> Vector:
    """Vector with one value of every joint, (n,)."""
    return np.array([of(joint) for joint in c.joints], dtype=np.float64)


def virtual_mass_of(c: Configuration) -> Vector:
    """Virtual mass (n,) as its time constant [s]: each joint's own, or the one for all."""
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


def sinusoids_of(c: Configuration) -> Sinusoids:
    """Configured sinusoids; joints without one hold."""
    waves = [c.trajectory.sinusoids.get(joint.name) for joint in c.joints]
    return Sinusoids(
        amplitude=np.array([wave.amplitude if wave else 0.0 for wave in waves]),
        omega=np.array([2.0 * np.pi * wave.frequency_Hz if wave else 0.0 for wave in waves]),
    )


def trajectory_of(c: Configuration, folder: Path) -> SampledPath | None:
    """Trajectory of `trajectory.file`, or None without one. Raises TrajectoryError, with the line
    and the reason, if it cannot be run."""
    if c.trajectory.file is None:
        return None
    file = read_trajectory(folder / c.trajectory.file, c.joint_names)
    try:
        builder = PathBuilder(
            file.path.name,
            c.joint_names,
            file.joints,
            limits_of(c),
            c.trajectory.ramp_s,
            from_here=c.trajectory.from_here,
        )
        builder.append(file.rows())
        return builder.finish()
    except TrajectoryError as error:
        raise file.placed(error) from error


def guide_of(c: Configuration) -> GuideAxes:
    """Guide of an arm that is led by hand."""
    a = c.admittance
    return GuideAxes(
        frame=a.frame, free=a.free, damped=a.damped, held=a.held, stiff=a.stiff,
        redundant=a.redundant,
    )  # fmt: skip
