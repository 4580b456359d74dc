"""RobStride as a make of drives: what `drivers.makes` asks of one."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from drivers.can.load import FrameLoad
from drivers.drive import Counts, Measure, ProfileProblem
from drivers.motors.recorded import MotorTicks
from drivers.robstride.frames import HOST, Kind, identifier, setpoint_id
from drivers.robstride.language import RobStrideLanguage
from drivers.robstride.settings import RobStrideDrive, RobStrideProfile


def problems(
    profile: RobStrideProfile,
    drives: Sequence[RobStrideDrive],
    folder: Path,
    period_ms: int,
    master_node: int,
) -> list[ProfileProblem]:
    """Problems of a profile, of which these are the drives."""
    figures = profile.figures
    found: list[ProfileProblem] = []
    for field, most in (("stiffness", figures.stiffest), ("damping", figures.most_damping)):
        given = getattr(profile, field)
        if given > most:
            text = f"{given:g}; a setpoint to an {profile.model} reaches {most:g}"
            found.append(((field,), text))
    return found + [
        (("model",), f"{drive.name}: {what}") for drive in drives for what in _wrong(drive)
    ]


def _wrong(drive: RobStrideDrive) -> Iterator[str]:
    """Problems of the wiring of one motor."""
    wiring, profile = drive.wiring, drive.profile
    if wiring.gear != profile.figures.gear:
        yield (
            f"gear {wiring.gear:g}; that of an {profile.model} is {profile.figures.gear:g}, and "
            "the joint must turn with its output"
        )
    if wiring.link_sign != wiring.motor_sign:
        yield "link_sign must be motor_sign: one encoder is both"
    if drive.play:
        yield (
            f"half_gap {drive.play / 2.0:g}; without an encoder at its output it must be 0 "
            "(docs/drives.md)"
        )
    if torque_limit(drive) > profile.torque_max_Nm:
        yield (
            f"max_current_A {wiring.max_current_A:g} means {torque_limit(drive):.3g} Nm; its "
            f"feedback ends at torque_max_Nm, {profile.torque_max_Nm:g}"
        )


def torque_limit(drive: RobStrideDrive) -> float:
    """Torque that a motor may give [Nm]."""
    return drive.wiring.max_current_A * drive.profile.Nm_per_A


def counts(drive: RobStrideDrive, measure: Measure) -> Counts:
    """Integers of a quantity of a motor, 0 at half of them."""
    profile = drive.profile
    at, most, per = {
        "effort": ("torque_max_Nm", profile.torque_max_Nm, profile.Nm_per_A),
        "link_position": ("position_max", profile.position_max, 1.0),
        "motor_velocity": ("velocity_max", profile.velocity_max, 1.0),
        "target_velocity": ("velocity_max", profile.velocity_max, 1.0),
    }[measure]
    bias = drive.wiring.link_offset if measure == "link_position" else 0.0
    gain = drive.wiring.motor_sign * 2.0 * most / per / 0xFFFF
    return Counts((at,), "16 bits", gain, bias - gain * 0xFFFF / 2.0, 0, 0xFFFF)


def frames(
    drives: Sequence[RobStrideDrive], period_s: float, master_node: int = 0
) -> tuple[FrameLoad, ...]:
    """Every periodic frame of an arm: each tick a setpoint and its answer."""
    tick_hz = 1.0 / period_s
    table = []
    for drive in drives:
        node = drive.node
        answer = identifier(Kind.FEEDBACK, node, HOST)
        table += [
            FrameLoad(f"{drive.name} setpoint", setpoint_id(node), 8, tick_hz),
            FrameLoad(f"{drive.name} answer", answer, 8, tick_hz),
        ]
    return tuple(table)


def recorded(drives: Sequence[RobStrideDrive], period_s: float) -> MotorTicks:
    """Ticks of recorded frames of an arm."""
    return MotorTicks(drives, RobStrideLanguage(drives), period_s)
