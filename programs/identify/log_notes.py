"""Notes on what a log shows beside what its step looks for: wrong currents, late encoders."""

from collections.abc import Sequence

from common.arrays import Vector
from daemon.config.schema import Configuration

_OFFSET = 0.01
"""Constant error of the current beyond which it is reported (share of the largest)."""
_LATE_S = 0.001
"""Lateness of a link encoder beyond which it is reported."""


def offsets(c: Configuration, offset: Vector) -> tuple[str, ...]:
    """Sentence about currents that show a torque (n,) [Nm] all the time, or none."""
    about = [
        f"{joint.name} by {by / joint.torque_constant:+.2f} A ({by:+.2g} Nm)"
        for joint, by in zip(c.joints, offset, strict=True)
        if abs(by) > _OFFSET * joint.torque_constant * joint.wiring.max_current_A
    ]
    if not about:
        return ()
    return (
        f"currents are off all the time: {', '.join(about)}, as far as masses are right "
        "(`contactd identify masses` separates the two). Have the drive find the zero of its "
        "current; the residual is off by as much",
    )


def late_encoders(joints: Sequence[str], late: Vector) -> tuple[str, ...]:
    """Sentence about link encoders that are later than the motor's (n,) [s], or none."""
    about = [
        f"{joint} by {1e3 * by:.1f} ms"
        for joint, by in zip(joints, late, strict=True)
        if by > _LATE_S
    ]
    if not about:
        return ()
    return (
        f"link encoders are late: {', '.join(about)}. This was taken into account here; for the "
        "arm at work give `estimator.link_position_delay_ms`, and repeat",
    )
