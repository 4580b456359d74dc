"""Black box: the last minute of frames, written to a log after a fault by another process.

The daemon keeps the frames in a `FrameRing` beside its control socket. Before it goes real-time it
starts a helper, which holds the other end of a pipe and sleeps: a line on the pipe is a fault, and
its end is the daemon's death, of whatever cause. Either way the helper writes the ring to a log of
python-can in the state directory, with the context needed to read it: configuration, URDF, and the
faults (`Context`). An orderly end is announced, and leaves no log. Nor does a start that failed: it
has no minute of frames, and a day of such starts would displace the logs of real faults.
"""

import contextlib
import fcntl
import logging
import math
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Final

import can
import msgspec

from common.errors import LogError
from common.new_file import refuse_suffix, refuse_unless_new
from common.regular_file import LARGEST_TEXT_BYTES, open_regular
from daemon.protocol.doors import DOORS, Door
from daemon.protocol.socket_path import open_to_group
from daemon.service.journal import log_to_stderr
from drivers.can.frame_ring import KEPT_S, FrameRing, Recorded, read_frames
from drivers.can.wire import ERROR, EXTENDED, REMOTE

# Time for which the helper waits after a fault, so that the log shows the reaction of the drives.
AFTERMATH_S: Final = 2.0
LOGS_KEPT: Final = 20
# Formats of python-can that other programs read.
FORMATS: Final = (".blf", ".log", ".asc")
# Room for emergencies and other frames on the bus.
MARGIN: Final = 1.2
_PATIENCE_S: Final = 10.0
# Shortest time between restarts of a helper that keeps dying.
HELPS_EVERY_S: Final = 10.0
#: Longest wait for the log when the daemon ends for a fault, as it is to be restarted soon [s].
FAULTED_PATIENCE_S: Final = 1.0
_ENDED: Final = b"ended\n"
_log = logging.getLogger("contactd")


def default_directory() -> Path:
    """Directory for logs: `$STATE_DIRECTORY` (systemd), else contactd's in the user's state."""
    if given := os.environ.get("STATE_DIRECTORY"):
        return Path(given.split(":")[0])
    home = os.environ.get("XDG_STATE_HOME")
    return (Path(home) if home else Path.home() / ".local" / "state") / "contactd"


def ring_path(socket: Path) -> Path:
    """Path of the ring of the daemon with this control socket: beside it, where memory is files."""
    return socket.with_name(f"{socket.name}.frames")


class Context(msgspec.Struct, frozen=True):
    """Context needed to read the frames of a log: the snapshot of a recording, without memory, and
    the faults with the time of day at which the helper received them [s]."""

    snapshot: msgspec.Raw
    faults: list[tuple[float, str]] = []


def context_path(ring: Path) -> Path:
    """Path of the daemon's snapshot for the helper: beside the ring."""
    return ring.with_suffix(".context")


def context_of_log(log: Path) -> Path:
    """Path of the context of a log: beside it."""
    return log.with_suffix(".json")


class BlackBox:
    """Daemon's side; a context that ends in good order unless an exception leaves it."""

    def __init__(self, path: Path, directory: Path, rate_hz: float, snapshot: bytes = b"") -> None:
        """Save the ring that an earlier daemon left, create the ring for a bus of `rate_hz` frames
        a second, and start the helper. `snapshot` is encoded, and describes the frames.

        Without a place for the ring or the log there is no black box: `ring` is None, and the
        reason is logged. The arm runs nevertheless.
        """
        self.ring: FrameRing | None = None
        self._path, self._directory = path, directory
        self._helper: subprocess.Popen[bytes] | None = None
        self._begun = False  # the loop ran
        self._unheard = ""  # fault that no helper received
        self._helped_s = -math.inf  # time of the last restart
        try:
            save_left_over(path, directory, patience_s=0.0)
            directory.mkdir(parents=True, exist_ok=True)
            self.ring = FrameRing(path, math.ceil(KEPT_S * MARGIN * rate_hz), time.monotonic)
            group = DOORS[Door.CONTROL].group
            open_to_group(path, 0o640, group)
            if snapshot:
                context_path(path).write_bytes(snapshot)
                open_to_group(context_path(path), 0o640, group)
            self._helper = _start_helper(path, directory)
        except (OSError, LogError) as error:
            _log.warning("no black box: %s", error)

    def __enter__(self) -> "BlackBox":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(orderly=kind is None or not self._begun)

    def begin(self) -> None:
        """Leave a log at any disorderly end from now on."""
        self._begun = True

    def report(self, fault: str) -> None:
        """Report a fault to the helper. Never waits: if the pipe is full, it has received one."""
        if self._helper and self._helper.stdin:
            try:
                os.write(self._helper.stdin.fileno(), fault.encode()[:200] + b"\n")
            except BlockingIOError:
                pass
            except OSError:
                self._unheard = fault  # for the next one: the frames are still there

    def look_after(self, now_s: float) -> None:
        """Restart the helper if it was killed, at most once in HELPS_EVERY_S, and report a fault
        that it missed; to be called now and then, between two ticks."""
        helper = self._helper
        if helper is None or now_s < self._helped_s + HELPS_EVERY_S or helper.poll() is None:
            return
        self._helped_s = now_s
        _log.warning("the black box's helper ended (%d): restarting it", helper.returncode)
        try:
            self._helper = _start_helper(self._path, self._directory)
        except OSError as error:
            _log.warning("no black box: %s", error)
            return
        if helper.stdin:
            helper.stdin.close()
        if missed := self._unheard:
            self._unheard = ""
            self.report(missed)

    def close(self, *, orderly: bool) -> None:
        """End the helper, and wait for a log that it still writes; after a fault only briefly, as
        the helper continues alone, and an incomplete log is saved at the next start."""
        if self._helper and self._helper.stdin:
            if orderly:
                self.report(_ENDED.decode().strip())
            self._helper.stdin.close()
            try:
                self._helper.wait(_PATIENCE_S if orderly else FAULTED_PATIENCE_S)
            except subprocess.TimeoutExpired:
                _log.warning("the black box is still being written")
        if self.ring:
            self.ring.close()


def _start_helper(path: Path, directory: Path) -> "subprocess.Popen[bytes]":
    # -P: no modules from the working directory. A session of its own: Ctrl-C does not reach it.
    command = [sys.executable, "-P", "-m", "daemon.service.black_box", str(path), str(directory)]
    helper = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True, bufsize=0)
    assert helper.stdin is not None
    os.set_blocking(helper.stdin.fileno(), False)
    return helper


# --- the helper's side --------------------------------------------------------------------------


def follow(path: Path, directory: Path, pipe: int, report: Callable[[str], None]) -> None:
    """Write a log after every fault, and after a death, until the pipe ends. Raises LogError."""
    with open_regular(path, follow=False) as ring:
        # A locked ring is in the care of a helper.
        fcntl.flock(ring, fcntl.LOCK_EX)
        alive = True
        while alive:
            heard = os.read(pipe, 4096)
            faults = _faults(heard)
            alive = _alive(heard)
            fault = heard != _ENDED
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
    return bool(heard) and not heard.endswith(_ENDED)


def _faults(heard: bytes) -> list[tuple[float, str]]:
    """Faults that the daemon has just reported, with the time of day [s]."""
    now = time.time()
    lines = heard.decode(errors="replace").splitlines()
    return [(now, line) for line in lines if line and line != _ENDED.decode().strip()]


def save(path: Path, directory: Path, faults: Sequence[tuple[float, str]] = ()) -> Path | None:
    """Write the frames of a ring to a new log in `directory`, with its context, and forget the
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
    """Write the context of `log` beside it, if the daemon of the ring left one. A log without
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
    """Path of a new log in `directory`, which is made: the time of day, UTC. Raises LogError."""
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


def save_left_over(path: Path, directory: Path, patience_s: float = _PATIENCE_S) -> Path | None:
    """Save the frames that a dead daemon left without a helper, and remove the ring; returns the
    log's path, None if there is none.

    Waits up to `patience_s` for a helper that is at work. Raises LogError.
    """
    end = time.monotonic() + patience_s
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


if __name__ == "__main__":
    os.nice(10)
    with log_to_stderr():
        follow(Path(sys.argv[1]), Path(sys.argv[2]), sys.stdin.fileno(), _log.warning)
