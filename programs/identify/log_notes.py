"""Notes on side findings in a log: current offsets, late encoders."""

from collections.abc import Sequence

from common.arrays import Vector
from daemon.config.schema import Configuration

_OFFSET = 0.01
"""Current offset above which it is reported, over the maximum current."""
_LATE_S = 0.001
"""Delay of a link encoder above which it is reported."""


def offsets(c: Configuration, offset: Vector) -> tuple[str, ...]:
    """Sentence about currents with an offset, given as torque (n,) [Nm], or none."""
    about = [
        f"{joint.name} by {by / joint.torque_constant:+.2f} A ({by:+.2g} Nm)"
        for joint, by in zip(c.joints, offset, strict=True)
        if abs(by) > _OFFSET * joint.torque_constant * joint.wiring.max_current_A
    ]
    if not about:
        return ()
    return (
        f"currents have an offset: {', '.join(about)}, if the masses are right (`contactd identify "
        "masses` separates the two). Have the drive calibrate its current zero; the residual is "
        "wrong by as much",
    )


def late_encoders(joints: Sequence[str], late: Vector) -> tuple[str, ...]:
    """Sentence about link encoders that are delayed (n,) [s] against the motor's, or none."""
    about = [
        f"{joint} by {1e3 * by:.1f} ms"
        for joint, by in zip(joints, late, strict=True)
        if by > _LATE_S
    ]
    if not about:
        return ()
    return (
        f"link encoders are late: {', '.join(about)}. This step compensated for it; for the "
        "running arm set `estimator.link_position_delay_ms`, and repeat",
    )
