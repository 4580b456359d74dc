"""Range and resolution of the drives' counts against the limits of the joints."""

from collections.abc import Iterator
from typing import Any

from daemon.config.schema import Joint, drive_of
from drivers.drive import Counts, Measure
from drivers.makes import DriveProfile, make_of

#: Largest velocity per count of a setpoint, over the velocity limit; more means a wrong scale.
COARSEST = 0.25


def unrepresentable(
    joint: Joint, profile: DriveProfile, speed_margin: float
) -> Iterator[tuple[Counts, str]]:
    """(counts, reason) for each quantity of a joint outside the integer range of its drive.

    Velocities must be representable up to `speed_margin` times the limit, otherwise overspeed of
    the motor could not be detected.
    """
    drive: Any = drive_of(joint, profile)
    make, limits = make_of(profile), joint.limits
    fastest = speed_margin * limits.velocity
    of_speed = f"{speed_margin:g} (supervisor.speed_margin) times limits.velocity is"
    spans: tuple[tuple[Measure, float, float, str, str], ...] = (
        ("target_velocity", -fastest, fastest, "rad/s", f"{of_speed} {fastest:g}"),
        ("motor_velocity", -fastest, fastest, "rad/s", f"{of_speed} {fastest:g}"),
        ("link_position", limits.lower, limits.upper, "rad",
         f"the limits are {limits.lower:g} and {limits.upper:g}"),
    )  # fmt: skip
    for measure, low, high, unit, allowed in spans:
        its = make.counts(drive, measure)
        lowest, highest = sorted(its.gain * end + its.bias for end in (its.lowest, its.highest))
        if not lowest <= low <= high <= highest:
            yield (
                its,
                f"{its.words} reach from {lowest:.4g} to {highest:.4g} {unit} at the link; "
                f"{allowed}",
            )
    target = make.counts(drive, "target_velocity")
    step = abs(target.gain)
    if step > COARSEST * limits.velocity:
        yield (
            target,
            f"one count is {step:.4g} rad/s at the link; at most {COARSEST:g} of limits.velocity "
            f"({limits.velocity:g}) is allowed",
        )
