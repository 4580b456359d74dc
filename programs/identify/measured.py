"""Measurements for the identification, from the daemon's stream, recordings, or other logs."""

import dataclasses
import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from common.arrays import Matrix
from common.errors import ContactdError, LogError, ShortLogError
from daemon.config.evidence import unidentified
from daemon.config.identified import same_residuals, same_samples
from daemon.config.load import Robot, parse_configuration
from daemon.config.schema import Configuration
from daemon.modes.table import SENSING, Mode
from daemon.protocol.state import Snapshot, State
from daemon.tick.sensing import HARMLESS
from daemon.tick.telemetry import FLAG_NAMES
from estimator.estimate import Flag
from identification.motion_log import MotionLog
from programs.clients.log_reader import read_log
from programs.identify.csv_log import COLUMNS, read_csv
from programs.identify.foreign import constants_of, foreign_states, joined, read_aligned
from programs.identify.log_names import is_foreign

_DOUBTS = {FLAG_NAMES[flag] for flag in Flag if flag not in HARMLESS}
_APART_S = 10.0  # pause between joined recordings, so that they count as separate stretches


@dataclass(frozen=True, slots=True)
class Measured:
    """Log of a motion with the residuals of the daemon's estimator, and a hash of the log."""

    log: MotionLog
    sha256: str
    residual: Matrix | None = None  # (N, n) [Nm]
    raised: Matrix | None = None  # (N, n) excess of the threshold over its level at speed [Nm]
    touched: NDArray[np.bool_] | None = None  # (N, n) thresholded residual is not zero
    uncertain: NDArray[np.bool_] | None = None  # (N,) residual is outdated or restarting
    reference: Matrix | None = None  # (N, n) positions [rad]; None if another controller moved it
    gain: float | None = None  # of the position loop [1/s]; None if unknown
    load: str = ""  # payload that the model included, in words
    notes: tuple[str, ...] = ()
    outdated: str = ""  # words on a recording whose residuals use outdated values


def read_measured(
    paths: Sequence[Path], c: Configuration, *, gap_of: str = "", robot: Robot | None = None,
    residuals: bool = False,
) -> Measured:  # fmt: skip
    """Measurements of recordings by `contactctl record`, joined, or of logs of other programs.

    gap_of: the only joint that such logs must contain; robot: removes the skew of their columns;
    residuals: runs the robot's estimator over them. Raises LogError, also for recordings made with
    other drives or another wiring than those of `c`.
    """
    foreign = [path for path in paths if is_foreign(path)]
    if foreign and (robot is None or not residuals):
        if len(foreign) < len(paths):
            raise LogError(f"{len(paths)} files: give either logs of other programs or recordings "
                           "of contactd (.mcap), not both")  # fmt: skip
        if robot is None or gap_of:
            joints = [gap_of] if gap_of else c.joint_names
            read = [read_csv(path, joints, constants_of(c), of_gap=bool(gap_of)) for path in paths]
        else:
            read = [read_aligned(path, c, robot.model) for path in paths]
        log, about = joined([one for one, _ in read])
        return Measured(log, _hash(log), notes=(*_named(paths, [n for _, n in read]), *about))
    states: list[State] = []
    notes: list[str] = []
    outdated = ""
    for path in paths:
        later = states[-1].time_s + _APART_S if states else 0.0
        if path in foreign and robot is not None:
            found, broken, recorded = foreign_states(path, robot)[1], "", c
            news = [one.text for one in found[0].notices if one.kind == "mode"]
            notes += [f"{path.name}: {text}" if len(paths) > 1 else text for text in news]
        else:
            found, broken, recorded = _states_of(path, c.joint_names)
        if why := incompatibility(recorded, c):
            raise LogError(f"{path} {why}")
        if why := incompatibility(recorded, c, residuals=True):
            outdated = f"{path} {why}"
        if broken:
            notes.append(f"{broken}; the intact part is used")
        begun = found[0].time_s
        states += [replace(s, time_s=s.time_s - begun + later) for s in raised(found, recorded)]
    if gap_of:
        states = moved(states)
    measured = from_states(states, c.joint_names, tuple(notes))
    measured = dataclasses.replace(measured, outdated=outdated, gain=recorded.control.position_gain)
    if not foreign or robot is None:
        return measured
    # Exceeding a level that was only guessed does not count as a touch.
    guessed = [name in unidentified("thresholds", robot.identified, c) for name in c.joint_names]
    touched = None if measured.touched is None else measured.touched & ~np.array(guessed)
    return dataclasses.replace(measured, reference=None, touched=touched)


def moved(states: list[State]) -> list[State]:
    """States of a gap measurement's motion, without those before and after it in which the arm
    held; all States if the arm mostly held, while a hand moved the link."""
    tracked = [s for s in states if s.mode == Mode.TRACKING]
    return tracked if 2 * len(tracked) > len(states) else states


def raised(states: Iterable[State], c: Configuration) -> list[State]:
    """States whose `threshold` is reduced by the contact level of `c` and its growth with speed, at
    least 0 where learning has lowered it, so that recordings made at different levels compare."""
    levels = np.array([joint.thresholds.contact for joint in c.joints])
    growth = np.array([joint.thresholds.per_speed for joint in c.joints])

    def beyond(s: State) -> list[float]:
        share = np.array(s.level_share or np.ones_like(levels))
        level = levels + share * growth * np.abs(s.motor_velocity)
        left: list[float] = np.maximum(s.threshold - level, 0.0).tolist()
        return left

    return [replace(s, threshold=beyond(s)) for s in states]


def incompatibility(recorded: Configuration, c: Configuration, *, residuals: bool = False) -> str:
    """Reason, to follow the recording's name, why its samples, or with `residuals` its residuals,
    cannot be used for `c`; empty if they can."""
    if not same_samples(recorded, c):
        return ("was recorded with other drives, another wiring or another period than the present "
                "configuration has")  # fmt: skip
    if residuals and not same_residuals(recorded, c):
        return "has residuals computed with other values of the joints than those in force"
    return ""


def refuse_incompatible(paths: Sequence[Path], c: Configuration, *, residuals: bool) -> None:
    """Check the configurations of recordings before a motion adds another one. Raises LogError that
    names those that cannot be combined with it."""
    reasons = []
    for path in paths:
        try:
            if why := incompatibility(_recorded_with(path), c, residuals=residuals):
                reasons.append(f"{path} {why}")
        except ContactdError as error:
            reasons.append(str(error))
    if reasons:
        them = "it" if len(reasons) == 1 else "them"
        raise LogError(f"{'; '.join(reasons)}: delete {them} and run this again")


def _recorded_with(path: Path) -> Configuration:
    begun: Snapshot | None = None
    for message in read_log(path):
        if isinstance(message, Snapshot):
            begun = message
        elif begun is not None:
            return configuration_of(begun, path)
    raise LogError(f"{path}: it contains no samples")


def _states_of(path: Path, joints: Sequence[str]) -> tuple[list[State], str, Configuration]:
    """States of a recording, why it breaks off (or empty), and its configuration. Raises LogError
    if it has no States."""
    states: list[State] = []
    begun: Snapshot | None = None
    broken: LogError | None = None
    try:
        for message in read_log(path):
            if isinstance(message, State):
                states.append(message)
                continue
            begun = message
            if begun.joints != list(joints):
                break
    except LogError as error:
        broken = error
    if begun is not None and begun.joints != list(joints):
        raise LogError(f"{path} is of another arm, with the joints {', '.join(begun.joints)}")
    if begun is None or not states:
        raise broken or LogError(f"{path}: it contains no samples")
    return states, str(broken or ""), configuration_of(begun, path)


def configuration_of(begun: Snapshot, path: Path | None = None) -> Configuration:
    """Configuration of the daemon that sent a snapshot. Raises ConfigurationError."""
    name = f"{path}, recorded" if path else "the running daemon's configuration"
    return parse_configuration(begun.configuration, name, begun.identified)


def from_states(
    states: Iterable[State], joints: Sequence[str], notes: tuple[str, ...] = ()
) -> Measured:
    """Measurements from ticks with complete samples in which the arm was energised. Pass States
    through `raised` first if their thresholds are used. Raises LogError."""
    used = [s for s in states if all(s.fresh) and s.mode in SENSING]
    if len(used) < 2:
        raise ShortLogError("the log is too short: the arm was never energised in it")
    columns = {
        name: np.array([getattr(s, name) for s in used], dtype=np.float64)
        for name in COLUMNS
        if getattr(used[0], name) is not None
    }
    log = MotionLog(tuple(joints), np.array([s.time_s for s in used]), **columns)
    thresholded = np.array([s.thresholded for s in used])
    # Residuals that are outdated or restarting, and levels raised for that, carry no information.
    uncertain = np.array([not all(s.sensing or [True]) or bool(_DOUBTS & {*s.flags}) for s in used])
    return Measured(
        log=log,
        sha256=_hash(log),
        residual=np.array([s.residual for s in used]),
        raised=np.array([s.threshold for s in used]),
        touched=thresholded != 0.0,
        uncertain=uncertain,
        reference=np.array([s.reference for s in used]),
        load=str(used[-1].payload or ""),
        notes=notes,
    )


def _named(paths: Sequence[Path], notes: Sequence[Sequence[str]]) -> list[str]:
    """Notes on each log, prefixed by its name if there are several."""
    pairs = zip(paths, notes, strict=True)
    return [f"{p.name}: {one}" if len(paths) > 1 else one for p, each in pairs for one in each]


def _hash(log: MotionLog) -> str:
    digest = hashlib.sha256()
    for values in (log.time_s, log.current, log.link_position, log.motor_velocity):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
