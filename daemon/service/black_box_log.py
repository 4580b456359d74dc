"""Logs of the black box: frames and context written from its ring, by its helper or afterwards."""

import contextlib
import fcntl
import logging
import os
import select
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Final

import can
import msgspec

from common.errors import LogError
from common.new_file import refuse_suffix, refuse_unless_new
from common.regular_file import LARGEST_TEXT_BYTES, open_regular
from drivers.can.frame_ring import Recorded, read_frames
from drivers.can.wire import ERROR, EXTENDED, REMOTE

# Time for which the helper waits after a fault, so that the log shows the reaction of the drives.
AFTERMATH_S: Final = 2.0
LOGS_KEPT: Final = 20
# Formats of python-can that other programs read.
FORMATS: Final = (".blf", ".log", ".asc")
TIMEOUT_S: Final = 10.0
ENDED: Final = b"ended\n"

_log = logging.getLogger("contactd")


class Context(msgspec.Struct, frozen=True):
    """Context needed to read the frames of a log: the snapshot of a recording, without memory, and
    the faults with the time of day at which the helper received them [s]."""

    snapshot: msgspec.Raw
    faults: list[tuple[float, str]] = []


def context_path(ring: Path) -> Path:
    """Path of the daemon's snapshot for the helper: next to the ring."""
    return ring.with_suffix(".context")


def context_of_log(log: Path) -> Path:
    """Path of the context of a log: next to it."""
    return log.with_suffix(".json")


def follow(path: Path, directory: Path, pipe: int, report: Callable[[str], None]) -> None:
    """Write a log after every fault, and if the daemon dies, until the pipe ends. Raises
    LogError."""
    with open_regular(path, follow=False) as ring:
        # The lock shows that a helper serves this ring.
        fcntl.flock(ring, fcntl.LOCK_EX)
        alive = True
        while alive:
            heard = os.read(pipe, 4096)
            faults = _faults(heard)
            alive = _alive(heard)
            fault = heard != ENDED
            end = time.monotonic() + AFTERMATH_S
            while fault and alive and (left := end - time.monotonic()) > 0.0:
                if select.select([pipe], [], [], left)[0]:
                    more = os.read(pipe, 4096)
                    faults += _faults(more)
                    alive = _alive(more)
            if fault and (saved := save(path, directory, faults)):
                report(f"black box: {saved}")
        _remove(path, ring)


def _alive(heard: bytes) -> bool:
    """True if the daemon is still running after it sent `heard`."""
    return bool(heard) and not heard.endswith(ENDED)


def _faults(heard: bytes) -> list[tuple[float, str]]:
    """Faults that the daemon has just reported, with the time of day [s]."""
    now = time.time()
    lines = heard.decode(errors="replace").splitlines()
    return [(now, line) for line in lines if line and line != ENDED.decode().strip()]


def save(path: Path, directory: Path, faults: Sequence[tuple[float, str]] = ()) -> Path | None:
    """Write the frames of a ring to a new log in `directory`, with its context, and delete the
    oldest logs.

    Returns the log's path, None if there are no frames. Raises LogError.
    """
    frames = read_frames(path)
    if not frames:
        return None
    target = write_log(frames, new_log(directory))
    write_context(path, target, faults)
    for old in sorted(directory.glob("frames-*Z.blf"))[:-LOGS_KEPT]:
        old.unlink(missing_ok=True)
        context_of_log(old).unlink(missing_ok=True)
    return target


def write_context(ring: Path, log: Path, faults: Sequence[tuple[float, str]] = ()) -> None:
    """Write the context of `log` next to it, if the daemon of the ring left one. A log without
    context is still usable: an error is only logged."""
    try:
        with open_regular(context_path(ring), follow=False) as stream:
            snapshot = stream.read(LARGEST_TEXT_BYTES)
        context = Context(msgspec.Raw(snapshot), list(faults))
        context_of_log(log).write_bytes(msgspec.json.encode(context))
    except FileNotFoundError:
        pass
    except OSError as error:
        _log.warning("%s has no context: %s", log, error)


def new_log(directory: Path) -> Path:
    """Path of a new log, named by the UTC time, in `directory`, which is created. Raises
    LogError."""
    now = time.time()
    stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime(now)) + f"{now % 1:.3f}"[1:] + "Z"
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LogError(f"{directory}: {error.strerror}") from error
    return directory / f"frames-{stamp}.blf"


def write_log(frames: list[Recorded], target: Path) -> Path:
    """Write frames by python-can's own writers, the format by the suffix of `target`.

    A partial file never gets that name, and no file is overwritten. Raises LogError.
    """
    refuse_suffix(target, FORMATS)
    refuse_unless_new(target)
    partial = target.with_name(f".{target.name}.partial{target.suffix}")
    try:
        partial.unlink(missing_ok=True)
        with can.Logger(str(partial)) as log:
            for frame in frames:
                log(_message(frame))
        partial.rename(target)
    except (OSError, ValueError) as error:
        with contextlib.suppress(OSError):
            partial.unlink()
        # `error` itself may name the partial file, which is internal.
        why = getattr(error, "strerror", None) or error
        raise LogError(f"cannot write {target}: {why}") from error
    return target


def save_left_over(path: Path, directory: Path, timeout_s: float = TIMEOUT_S) -> Path | None:
    """Save the frames that a dead daemon left without a helper, and remove the ring; returns the
    log's path, None if there is none.

    Waits up to `timeout_s` for a helper that is still writing. Raises LogError.
    """
    end = time.monotonic() + timeout_s
    try:
        with open_regular(path, follow=False) as ring:
            while True:
                try:
                    fcntl.flock(ring, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() >= end:
                        return None
                    time.sleep(0.05)
            if not path.exists():
                return None
            saved = save(path, directory)
            _remove(path, ring)
            return saved
    except FileNotFoundError:
        return None
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from error


def _remove(path: Path, ring: IO[bytes]) -> None:
    """Remove the ring, unless another daemon has put its own there."""
    try:
        if path.stat().st_ino == os.fstat(ring.fileno()).st_ino:
            path.unlink()
            context_path(path).unlink(missing_ok=True)
    except FileNotFoundError:
        pass


def _message(frame: Recorded) -> can.Message:
    extended = bool(frame.can_id & EXTENDED)
    return can.Message(
        timestamp=frame.time_s,
        arbitration_id=frame.can_id & (0x1FFF_FFFF if extended else 0x7FF),
        data=frame.data,
        is_extended_id=extended,
        is_remote_frame=bool(frame.can_id & REMOTE),
        is_error_frame=bool(frame.can_id & ERROR),
        is_rx=not frame.sent,
        channel=0,
    )
