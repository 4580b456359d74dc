"""Range and resolution of the drives' counts against the limits of the joints."""

from collections.abc import Iterator

from daemon.config.schema import Joint, drive_of
from drivers.codec import link_side, quantity, type_limits
from drivers.settings import DriveProfile, PdoEntry

#: Largest step of a setpoint, as a share of the velocity limit; a coarser one is a wrong scale.
COARSEST = 0.25


def unrepresentable(joint: Joint, profile: DriveProfile) -> Iterator[tuple[str, str]]:
    """(quantity, reason) for each quantity of a joint that the counts of its drive cannot hold."""
    drive, limits = drive_of(joint, profile), joint.limits
    spans: tuple[tuple[PdoEntry, float, float, str], ...] = (
        ("target_velocity", -limits.velocity, limits.velocity, "rad/s"),
        ("motor_velocity", -limits.velocity, limits.velocity, "rad/s"),
        ("link_position", limits.lower, limits.upper, "rad"),
    )
    for entry, *span, unit in spans:
        where = quantity(profile, entry)
        gain, bias = link_side(drive, entry)
        lowest, highest = sorted(gain * counts + bias for counts in type_limits(where.type))
        if not lowest <= min(span) <= max(span) <= highest:
            yield (
                entry,
                f"{where.type} counts reach from {lowest:.4g} to {highest:.4g} {unit} at the link; "
                f"the limits are {min(span):g} and {max(span):g}",
            )
    step = abs(link_side(drive, "target_velocity")[0])
    if step > COARSEST * limits.velocity:
        yield (
            "target_velocity",
            f"one count is {step:.4g} rad/s at the link; at most {COARSEST:g} of limits.velocity "
            f"({limits.velocity:g}) is allowed",
        )
