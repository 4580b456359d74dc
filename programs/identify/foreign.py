"""Conversion of another program's log to a recording: runs a robot's estimator over its samples."""

from dataclasses import replace
from hashlib import blake2b
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from scipy.signal import savgol_filter

from common import compiled
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from daemon.config.vectors import row
from daemon.protocol.state import Snapshot, State
from estimator.body_inertia import point_mass
from estimator.model import Model
from estimator.payload import Payload
from identification.motion_log import MotionLog
from identification.skew import without_skew
from identification.torque_columns import refuse_other_torques
from identification.vibration import without_vibration
from programs.identify.csv_log import COLUMNS, read_csv
from programs.identify.log_names import beside, read_names
from programs.recordings.over_log import over_log
from programs.recordings.raster import on_raster
from programs.recordings.recomputed import kept_recording
from programs.recordings.row_cache import content_digest

_APART_S: Final = 10.0  # pause between joined logs, so that they count as separate stretches
_ALIKE: Final = 0.02  # relative difference of periods that are taken as equal
_FASTER: Final = 0.6  # of the configured period: logs with a shorter one are resampled
_SMOOTH_S: Final = 0.05  # half of the smoothing window for a load's acceleration
_LAYOUT: Final = 2  # version of the recordings in the cache


def foreign_states(path: Path, robot: Robot) -> tuple[Snapshot, list[State]]:
    """Snapshot and States computed from a log. Raises LogError."""
    load = _payload(path, robot.model)
    log, notes = read_aligned(path, robot.configuration, robot.model)
    return over_log(_carrying(log, load, robot.configuration, robot.model), robot, notes, load)


def read_aligned(path: Path, c: Configuration, model: Model) -> tuple[MotionLog, tuple[str, ...]]:
    """Log of all joints with skew, vibration and the payload of its names file removed, and notes
    on these. Raises LogError."""
    log, notes = read_csv(path, c.joint_names, constants_of(c))
    if log.period_s < _FASTER * c.period_s:  # faster samples add no information
        log = on_raster(log, log.stretches(2.5 * log.period_s), c.period_s)
    load = _payload(path, model)
    if load is not None:
        log = _carrying(log, load, c, model, -1.0)
        notes += (f"the hand carries {load}",)
    log, skew = without_skew(log, model, c.estimator)
    refuse_other_torques(log, model, c.estimator)
    log, shakes = without_vibration(log, model, c.estimator, row(c, lambda j: j.torque_constant))
    return log, notes + skew.notes(log.joints) + shakes


def _payload(path: Path, model: Model) -> Payload | None:
    named = read_names(path)
    if named is None or named.payload is None:
        return None
    return Payload.of(named.payload.mass, named.payload.com or model.tool_place.tolist())


def _carrying(
    log: MotionLog, load: Payload | None, c: Configuration, model: Model, sign: float = 1.0
) -> MotionLog:
    """Log whose currents additionally carry a load, or with sign -1 no longer carry it."""
    if load is None:
        return log
    point, hand = point_mass(load.mass, model.in_joint(np.array(load.com))), model.hand_joint
    width, current = max(5, 2 * round(_SMOOTH_S / log.period_s) + 1), log.current.copy()
    for part in log.stretches():
        if part.stop - part.start <= width:
            continue
        q = log.link_position[part]
        motion = [savgol_filter(q, width, 2, k, log.period_s, axis=0) for k in (1, 2)]
        torque = [model.regressor(*at)[:, hand] @ point for at in zip(q, *motion, strict=True)]
        current[part] += sign * np.array(torque) / row(c, lambda j: j.torque_constant)
    return replace(log, current=current)


def recording_of(path: Path, config: Path) -> Path:
    """Path, in the user's cache, of a log's recording with the robot of `config`. Raises
    ContactdError."""
    robot, names = load_robot(config), beside(path)
    what = [
        _LAYOUT, version("contactd"), compiled.sources(), content_digest(path),
        content_digest(names) if names.exists() else "", robot.text, robot.identified_text,
        robot.urdf,
    ]  # fmt: skip
    key = blake2b(msgspec.json.encode(what), digest_size=16).hexdigest()
    return kept_recording(path, key, lambda: foreign_states(path, robot))


def constants_of(c: Configuration) -> dict[str, float]:
    """Torque constants [Nm/A] by joint."""
    return {joint.name: joint.torque_constant for joint in c.joints}


def joined(logs: list[MotionLog]) -> tuple[MotionLog, tuple[str, ...]]:
    """Concatenation of logs of the same joints at the longest of their periods, and notes."""
    first, *others = logs
    if not others:
        return first, ()
    notes: tuple[str, ...] = ()
    period = max(log.period_s for log in logs)
    if min(log.period_s for log in logs) < (1.0 - _ALIKE) * period:
        notes = (f"logs at several rates: all resampled to {1e3 * period:.3g} ms",)
        logs = [on_raster(log, log.stretches(2.5 * log.period_s), period) for log in logs]
    times, begin = [], 0.0
    for log in logs:
        times.append(log.time_s - log.time_s[0] + begin)
        begin = float(times[-1][-1]) + _APART_S

    columns: dict[str, Any] = {}
    for name in COLUMNS:
        each = [getattr(log, name) for log in logs]
        columns[name] = None if any(one is None for one in each) else np.concatenate(each)
    return replace(first, time_s=np.concatenate(times), **columns), notes
