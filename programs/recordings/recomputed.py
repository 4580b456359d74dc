"""Recording from the black box's frames: samples of the drives, and recomputed estimates.

The frames are decoded as in the daemon. The estimator starts afresh, as after switching on: frames
do not contain what it had learned, so its levels are higher than those that were in force. Nor do
they contain modes: an arm whose drives are all enabled counts as holding. Faults are those that the
daemon reported to the black box.
"""

import contextlib
import math
import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import can
import msgspec
import numpy as np

from common.errors import LogError
from common.new_file import whole_file
from daemon.assembly import build_estimator
from daemon.config.dynamics import model_of
from daemon.config.load import parse_configuration
from daemon.config.schema import Configuration
from daemon.modes.table import Mode
from daemon.protocol.state import Notice, Snapshot, State, format_refusal
from daemon.service.black_box import default_directory
from daemon.service.black_box_log import FORMATS, Context, context_of_log
from daemon.tick.decision import Decision
from daemon.tick.telemetry import TickRecord, Wakeup, state_of
from drivers.api import DriveCondition, Samples
from drivers.can.wire import frame_of
from estimator.estimator import Estimator
from programs.clients.log_writer import LogWriter
from programs.recordings.row_cache import cache_directory, content_digest, forget_oldest

SERVICE_STATE: Final = Path("/var/lib/contactd")
CAUSE: Final = "recomputed from frames: neither modes nor what was learned are on the bus"
#: Readers and modes of opening; the file is opened here, as readers do not close it on an error.
_READERS: Final[dict[str, tuple[Any, str]]] = {
    ".blf": (can.BLFReader, "rb"),
    ".log": (can.CanutilsLogReader, "r"),
    ".asc": (can.ASCReader, "r"),
}
_LAYOUT: Final = 2  # version of the recordings in the cache


def last_fault() -> Path:
    """Newest black-box log with a fault, else the newest log, of this user or the service. Raises
    LogError."""
    places = [default_directory(), SERVICE_STATE]
    logs: list[Path] = []
    for place in places:
        try:
            logs += place.glob("frames-*Z.blf")
        except OSError:
            continue
    if not logs:
        where = " or ".join(map(str, dict.fromkeys(places)))
        raise LogError(f"there is no black-box log in {where}")
    logs.sort(key=lambda log: log.name, reverse=True)
    return next((log for log in logs if _faults_of(log)), logs[0])


def _faults_of(log: Path) -> list[tuple[float, str]]:
    """Faults in the context of a log; none if there is no readable context."""
    try:
        return msgspec.json.decode(context_of_log(log).read_bytes(), type=Context).faults
    except (OSError, msgspec.DecodeError):
        return []


def as_recording(path: Path) -> Path:
    """Recording of a black-box log, kept in the user's cache; any other file is returned as a
    recording. Raises LogError."""
    if path.suffix.lower() not in FORMATS:
        return path
    context = context_of_log(path)
    if not context.exists():
        raise LogError(f"{path}: {context.name}, which describes its frames, is not beside it")
    of_what = f"{content_digest(path)[:12]}-{content_digest(context)[:12]}-{_LAYOUT}"
    return kept_recording(path, of_what, lambda: recomputed(path, context))


def kept_recording(
    log: Path, of_what: str, make: Callable[[], tuple[Snapshot, list[State]]]
) -> Path:
    """Recording of a log in the user's cache, made unless `of_what` is there. Raises LogError."""
    target = cache_directory() / "recomputed" / of_what / f"{log.stem}.mcap"
    if not target.exists():
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LogError(f"cannot write {target}: {error.strerror or error}") from error
        found = make()
        with whole_file(target) as partial:
            _write(partial, *found)
        forget_oldest(target.parent.parent, keep=target.parent)
    with contextlib.suppress(OSError):
        os.utime(target.parent)  # marks it as recently used
    return target


def recomputed(log: Path, context: Path) -> tuple[Snapshot, list[State]]:
    """Snapshot and States of a log. Raises LogError, ConfigurationError."""
    try:
        kept = msgspec.json.decode(context.read_bytes(), type=Context)
        snapshot = msgspec.json.decode(kept.snapshot, type=Snapshot)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise LogError(f"{context} cannot be read: {error}") from error
    if refusal := format_refusal(snapshot.format):
        raise LogError(f"{context} is {refusal}")
    c = parse_configuration(snapshot.configuration, str(context), snapshot.identified)
    try:
        reader, mode = _READERS[log.suffix.lower()]
        with log.open(mode) as stream:
            states = list(_states(reader(stream), c, snapshot.urdf, kept.faults))
    except (OSError, ValueError, struct.error, can.CanError) as error:
        raise LogError(f"{log} cannot be read: {error}") from error
    if not states:
        raise LogError(f"{log}: it contains no SYNC with the answers of all drives")
    return snapshot, states


def _states(
    frames: Any, c: Configuration, urdf: str, faults: list[tuple[float, str]]
) -> Iterator[State]:
    """States of all ticks from the first in which all drives have answered."""
    ticks = c.make.recorded(c.joint_drives, c.period_s)
    run = _Recomputing(c, build_estimator(c, model_of(c, urdf)), faults)
    begun_s: float | None = None
    for frame in frames:
        if frame.is_error_frame or frame.is_remote_frame:
            continue
        can_id, data, sent = frame_of(frame)[0], bytes(frame.data), not frame.is_rx
        if ticks.begins(can_id, data, sent=sent):
            if begun_s is not None:
                state = run.state(begun_s, ticks.finish(), ticks.velocity, begun_s)
                if state is not None:
                    yield state
            begun_s = float(frame.timestamp)
            ticks.begin(begun_s)
        ticks.take(can_id, data, sent=sent)
    if begun_s is not None:  # the last tick, with the faults after it
        state = run.state(begun_s, ticks.finish(), ticks.velocity, math.inf)
        if state is not None:
            yield state


class _Recomputing:
    """Computation of consecutive States."""

    def __init__(
        self, c: Configuration, estimator: Estimator, faults: list[tuple[float, str]]
    ) -> None:
        self._estimator, self._period_s = estimator, c.period_s
        self._faults = sorted(faults)
        self._begun_s: float | None = None
        self._before_s = 0.0
        self._tick = -1
        self._faulted = False

    def state(
        self, time_s: float, samples: Samples, setpoint: np.ndarray, until_s: float
    ) -> State | None:
        """State of the SYNC at Unix time time_s [s], with faults up to until_s; None before all
        drives have answered."""
        if not np.isfinite(samples.current).all():
            return None
        if self._begun_s is None:
            self._begun_s, self._before_s = time_s, time_s - self._period_s
        interval_s = time_s - self._before_s
        if not 0.0 < interval_s < math.inf:
            return None
        self._before_s = time_s
        self._tick += 1
        estimate = self._estimator.step(
            samples.current, samples.link_position, samples.motor_velocity,
            samples.motor_position, interval_s, fresh=samples.fresh,
        )  # fmt: skip
        since_s = time_s - self._begun_s
        return state_of(
            TickRecord(
                number=self._tick,
                time_s=since_s,
                wakeup=Wakeup(monotonic_s=since_s, wall_s=time_s),
                samples=samples,
                interval_s=interval_s,
                estimate=estimate,
                sensing=estimate.sensing,
                sensing_since_s=np.zeros(len(samples.current)),
                decision=Decision(
                    power=(), reset=False, velocity=setpoint, reference=samples.link_position
                ),
                mode=self._mode(samples, until_s),
                cause=CAUSE,
                notices=self._notices(until_s),
            )
        )

    def _notices(self, time_s: float) -> tuple[Notice, ...]:
        notices = []
        while self._faults and self._faults[0][0] <= time_s:
            notices.append(Notice(kind="fault", text=self._faults.pop(0)[1]))
        self._faulted = self._faulted or bool(notices)
        return tuple(notices)

    def _mode(self, samples: Samples, time_s: float) -> Mode:
        if all(drive.condition is DriveCondition.OPERATING for drive in samples.drives):
            return Mode.HOLDING
        now = bool(self._faults) and self._faults[0][0] <= time_s
        return Mode.FAULTED if self._faulted or now else Mode.OFF


def _write(path: Path, snapshot: Snapshot, states: list[State]) -> None:
    """Write a recording of these States."""
    with path.open("wb") as stream:
        log = LogWriter(stream, snapshot.program)
        log.write(Snapshot, msgspec.json.encode(snapshot), states[0].timing.wall_s)
        for state in states:
            log.write(State, msgspec.json.encode(state), state.timing.wall_s)
        log.finish()
