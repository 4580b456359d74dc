"""Trajectories of a configuration: their checks against the limits, and their paths."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from common.errors import TrajectoryError
from daemon.config.problem import Problem
from daemon.config.schema import Configuration
from daemon.config.vectors import limits_of
from daemon.motion.path import JointPath, Sinusoids
from daemon.motion.sampled_path import PathBuilder, SampledPath
from daemon.motion.trajectory_file import read_trajectory


def trajectory_checks(c: Configuration) -> Iterator[Problem]:
    """Problems of the trajectory: unknown joints, file and sinusoids at once, exceeded limits."""
    joints = {joint.name: joint for joint in c.joints}
    if c.trajectory.file is not None and c.trajectory.sinusoids:
        yield Problem(
            ["trajectory", "file"],
            "trajectory.file",
            f"`{c.trajectory.file}` beside trajectory.sinusoids: give either a file or sinusoids",
        )
    for name, wave in c.trajectory.sinusoids.items():
        keys: list[str | int] = ["trajectory", "sinusoids", name]
        where = f"trajectory.sinusoids.{name}"
        if name not in joints:
            yield Problem(keys, where, f"no such joint; there are: {', '.join(joints)}")
            continue
        limits, omega = joints[name].limits, 2 * math.pi * wave.frequency_Hz
        if (peak := wave.amplitude * omega) > limits.velocity:
            yield Problem(
                keys, where, f"its speed of {peak:.3g} rad/s is above the limit {limits.velocity:g}"
            )
        # Peak of A w^2 |sin| plus A w |cos| / ramp: the soft start may occur at any phase.
        peak = wave.amplitude * omega * math.hypot(omega, 1.0 / c.trajectory.ramp_s)
        if peak > limits.acceleration:
            yield Problem(
                keys,
                where,
                f"its acceleration of {peak:.3g} rad/s2 (a soft start included) is above the limit "
                f"{limits.acceleration:g}",
            )
        if 2 * wave.amplitude > limits.upper - limits.lower:
            yield Problem(
                keys,
                where,
                f"its swing of {2 * wave.amplitude:g} rad does not fit between the limits "
                f"{limits.lower:g} and {limits.upper:g}",
            )


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


def path_of(c: Configuration, from_file: SampledPath | None) -> JointPath:
    """Path that `start` runs: that of `trajectory.file`, as loaded, or the sinusoids."""
    return from_file or sinusoids_of(c)
