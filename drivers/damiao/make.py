"""Damiao as a make of drives: the interface of `drivers.makes`."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from drivers.can.load import FrameLoad
from drivers.damiao.frames import ANSWERS, REGISTERS
from drivers.damiao.language import DamiaoLanguage
from drivers.damiao.settings import DamiaoDrive, DamiaoProfile
from drivers.drive import Counts, Measure, ProfileProblem
from drivers.motors.language import steps_of
from drivers.motors.recorded import MotorTicks

#: Highest ID that fits beside the status in a feedback.
HIGHEST_ID: Final = 15


def problems(
    profile: DamiaoProfile,
    drives: Sequence[DamiaoDrive],
    folder: Path,
    period_ms: int,
    master_node: int,
) -> list[ProfileProblem]:
    """Problems of a profile: none, as its values are compared with the motors at the start."""
    return []


def wrong(drive: DamiaoDrive) -> Iterator[ProfileProblem]:
    """Problems of the joint with this motor, by field."""
    wiring, profile = drive.wiring, drive.profile
    if wiring.node > HIGHEST_ID:
        yield ("wiring", "node"), f"{wiring.node}; the ID of a Damiao motor is 1 to {HIGHEST_ID}"
    if wiring.gear != profile.figures.gear:
        its = f"that of a {profile.model} is {profile.figures.gear:g}"
        text = f"{wiring.gear:g}; {its}, and the joint must turn with its output"
        yield ("wiring", "gear"), text
    if wiring.link_sign != wiring.motor_sign:
        yield ("wiring", "link_sign"), "must equal motor_sign: both encoders are in one motor"


def counts(drive: DamiaoDrive, measure: Measure) -> Counts:
    """Integer scale of a quantity of a motor, with 0 at mid-range."""
    profile, sign = drive.profile, drive.wiring.motor_sign
    position, velocity, torque = steps_of(profile, DamiaoLanguage.bits)
    at, scale, bits = {
        "effort": ("torque_max_Nm", torque / profile.Nm_per_A, 12),
        "link_position": ("position_max", position, 16),
        "motor_velocity": ("velocity_max", velocity, 12),
        "target_velocity": ("velocity_max", velocity, 12),
    }[measure]
    bias = drive.wiring.link_offset if measure == "link_position" else 0.0
    most, gain = (1 << bits) - 1, sign * scale
    return Counts((at,), f"{bits} bits", gain, bias - gain * most / 2.0, 0, most)


def frames(
    drives: Sequence[DamiaoDrive], period_s: float, master_node: int = 0
) -> tuple[FrameLoad, ...]:
    """All periodic frames of an arm: two requests and a setpoint per tick, with their answers."""
    tick_hz = 1.0 / period_s
    table = []
    for drive in drives:
        answers = drive.node + ANSWERS
        table += [
            FrameLoad(f"{drive.name} requests", REGISTERS, 8, 2.0 * tick_hz),
            FrameLoad(f"{drive.name} setpoint", drive.node, 8, tick_hz),
            FrameLoad(f"{drive.name} answers", answers, 8, 3.0 * tick_hz),
        ]
    return tuple(table)


def recorded(drives: Sequence[DamiaoDrive], period_s: float) -> MotorTicks:
    """Reconstruction of an arm's ticks from its recorded frames."""
    return MotorTicks(drives, DamiaoLanguage(drives), period_s)
