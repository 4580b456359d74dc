"""Checks of the configured trajectory against the limits."""

import math
from collections.abc import Iterator

from daemon.config.problem import Problem
from daemon.config.schema import Configuration


def trajectory(c: Configuration) -> Iterator[Problem]:
    """Problems of the trajectory: an unknown joint, two kinds at once, motion beyond a limit."""
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
        # A w^2 |sin| with A w |cos| / ramp of a soft start, which may fall on any phase.
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
