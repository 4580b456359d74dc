"""Range and resolution of the drives' counts against the limits of the joints."""

from collections.abc import Iterator

from daemon.config.schema import Joint, drive_of
from drivers.canopen.codec import link_side, quantity, type_limits
from drivers.canopen.settings import DriveProfile, PdoEntry

#: Largest step of a setpoint, as a share of the velocity limit; a coarser one is a wrong scale.
COARSEST = 0.25


def unrepresentable(
    joint: Joint, profile: DriveProfile, speed_margin: float
) -> Iterator[tuple[PdoEntry, str]]:
    """(quantity, reason) for each quantity of a joint outside the integer range of its drive.

    Velocities must be representable up to `speed_margin` times the limit: otherwise overspeed of
    the motor could not be detected.
    """
    drive, limits = drive_of(joint, profile), joint.limits
    fastest = speed_margin * limits.velocity
    of_speed = f"{speed_margin:g} (supervisor.speed_margin) times limits.velocity is"
    spans: tuple[tuple[PdoEntry, float, float, str, str], ...] = (
        ("target_velocity", -fastest, fastest, "rad/s", f"{of_speed} {fastest:g}"),
        ("motor_velocity", -fastest, fastest, "rad/s", f"{of_speed} {fastest:g}"),
        ("link_position", limits.lower, limits.upper, "rad",
         f"the limits are {limits.lower:g} and {limits.upper:g}"),
    )  # fmt: skip
    for entry, low, high, unit, allowed in spans:
        where = quantity(profile, entry)
        gain, bias = link_side(drive, entry)
        lowest, highest = sorted(gain * counts + bias for counts in type_limits(where.type))
        if not lowest <= low <= high <= highest:
            yield (
                entry,
                f"{where.type} counts reach from {lowest:.4g} to {highest:.4g} {unit} at the link; "
                f"{allowed}",
            )
    step = abs(link_side(drive, "target_velocity")[0])
    if step > COARSEST * limits.velocity:
        yield (
            "target_velocity",
            f"one count is {step:.4g} rad/s at the link; at most {COARSEST:g} of limits.velocity "
            f"({limits.velocity:g}) is allowed",
        )
