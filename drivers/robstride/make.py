"""RobStride as a make of drives: the interface of `drivers.makes`."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from drivers.can.load import FrameLoad
from drivers.drive import Counts, Measure, ProfileProblem
from drivers.motors.recorded import MotorTicks
from drivers.robstride.frames import HOST, Kind, identifier, setpoint_id
from drivers.robstride.language import RobStrideLanguage
from drivers.robstride.settings import FEEDBACK, RobStrideDrive, RobStrideProfile


def problems(
    profile: RobStrideProfile,
    drives: Sequence[RobStrideDrive],
    folder: Path,
    period_ms: int,
    master_node: int,
) -> list[ProfileProblem]:
    """Problems of a profile that these drives use."""
    figures, model = profile.figures, profile.model
    torque, velocity = FEEDBACK[model]
    manuals = f"the highest value in manuals of the {model} is"
    bounds = (
        ("stiffness", figures.stiffest, f"a setpoint to an {model} allows at most"),
        ("damping", figures.most_damping, f"a setpoint to an {model} allows at most"),
        ("torque_max_Nm", torque, manuals),
        ("velocity_max", velocity, manuals),
    )
    return [
        ((field,), f"{given:g}; {what} {most:g}")
        for field, most, what in bounds
        if (given := getattr(profile, field)) > most
    ]


def wrong(drive: RobStrideDrive) -> Iterator[ProfileProblem]:
    """Problems of the joint with this motor, by field."""
    wiring, profile = drive.wiring, drive.profile
    if wiring.gear != profile.figures.gear:
        its = f"that of an {profile.model} is {profile.figures.gear:g}"
        text = f"{wiring.gear:g}; {its}, and the joint must turn with its output"
        yield ("wiring", "gear"), text
    if wiring.link_sign != wiring.motor_sign:
        yield ("wiring", "link_sign"), "must equal motor_sign: one encoder serves as both"
    if drive.play:
        text = "without an encoder at its output it must be 0 (docs/drives.md)"
        yield ("half_gap",), f"{drive.play / 2.0:g}; {text}"
    if torque_limit(drive) > profile.torque_max_Nm:
        text = (
            f"{wiring.max_current_A:g} means {torque_limit(drive):.3g} Nm; its feedback saturates "
            f"at torque_max_Nm, {profile.torque_max_Nm:g}"
        )
        yield ("wiring", "max_current_A"), text


def torque_limit(drive: RobStrideDrive) -> float:
    """Torque limit of a motor [Nm]."""
    return drive.wiring.max_current_A * drive.profile.Nm_per_A


def counts(drive: RobStrideDrive, measure: Measure) -> Counts:
    """Integer scale of a quantity of a motor, with 0 at mid-range."""
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
    """All periodic frames of an arm: a setpoint and its answer per tick."""
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
    """Reconstruction of an arm's ticks from its recorded frames."""
    return MotorTicks(drives, RobStrideLanguage(drives), period_s)
