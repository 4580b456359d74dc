"""Black box: the last minute of frames, written to a log after a fault by another process.

The daemon keeps the frames in a `FrameRing` beside its control socket. Before it goes real-time it
starts a helper, which holds the other end of a pipe and sleeps: a line on the pipe is a fault, and
its end is the daemon's death, however it came. Either way the helper writes the ring to a log of
python-can in the state directory, and beside it what the frames mean: configuration, URDF, and the
faults (`Context`). An orderly end says so, and leaves nothing; so does a start that failed: it has
no minute to tell of, and a day of them would push out the logs of what did happen.
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
from types import TracebackType
from typing import IO, Final

import can
import msgspec

from daemon.new_file import refuse_suffix, refuse_unless_new
from daemon.protocol.doors import DOORS, Door
from daemon.protocol.socket_path import open_to_group
from daemon.service.journal import log_to_stderr
from drivers.can.frame_ring import KEPT_S, FrameRing, Recorded, read_frames
from drivers.can.wire import ERROR, EXTENDED, REMOTE
from errors import LogError
from regular_file import LARGEST_TEXT_BYTES, open_regular

# After a fault the helper waits so long for what the drives do about it.
AFTERMATH_S: Final = 2.0
LOGS_KEPT: Final = 20
# Of the many that python-can writes, those that others read.
FORMATS: Final = (".blf", ".log", ".asc")
# Emergencies and whatever else is on the bus take room, too.
MARGIN: Final = 1.2
_PATIENCE_S: Final = 10.0
# A helper that dies all the time is begun anew no oftener.
HELPS_EVERY_S: Final = 10.0
#: A daemon that ends for a fault is wanted again: so long it waits for its log at most [s].
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
    """What is needed to read the frames of a log: the snapshot of a recording, without memory, and
    the faults with the time of day at which the helper heard of them [s]."""

    snapshot: msgspec.Raw
    faults: list[tuple[float, str]] = []


def context_path(ring: Path) -> Path:
    """Where the daemon keeps its snapshot for the helper: beside the ring."""
    return ring.with_suffix(".context")


def context_of_log(log: Path) -> Path:
    """Where the context of a log is: beside it."""
    return log.with_suffix(".json")


class BlackBox:
    """Daemon's side; a context that ends in good order unless an exception leaves it."""

    def __init__(self, path: Path, directory: Path, rate_hz: float, snapshot: bytes = b"") -> None:
        """Save what an earlier daemon left, make the ring, for a bus of `rate_hz` frames a second,
        and start the helper. `snapshot` is encoded, and says what the frames mean.

        Without a place for the ring or the log there is no black box: `ring` is None, and the log
        says why. The arm runs all the same.
        """
        self.ring: FrameRing | None = None
        self._path, self._directory = path, directory
        self._helper: subprocess.Popen[bytes] | None = None
        self._begun = False  # the loop ran
        self._unheard = ""  # fault that no helper heard of
        self._helped_s = -math.inf  # when it was last begun anew
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close(orderly=kind is None or not self._begun)

    def begin(self) -> None:
        """From now on an end in disorder leaves a log."""
        self._begun = True

    def tell(self, fault: str) -> None:
        """Report a fault to the helper. Never waits: a full pipe says that it knows of one."""
        if self._helper and self._helper.stdin:
            try:
                os.write(self._helper.stdin.fileno(), fault.encode()[:200] + b"\n")
            except BlockingIOError:
                pass
            except OSError:
                self._unheard = fault  # for the next one: the frames are still there

    def look_after(self, now_s: float) -> None:
        """Begin the helper anew if it was killed, at most once in HELPS_EVERY_S; to be called now
        and then, between two ticks. It hears of a fault that it missed."""
        helper = self._helper
        if helper is None or now_s < self._helped_s + HELPS_EVERY_S or helper.poll() is None:
            return
        self._helped_s = now_s
        _log.warning("the black box's helper ended (%d): it is begun anew", helper.returncode)
        try:
            self._helper = _start_helper(self._path, self._directory)
        except OSError as error:
            _log.warning("no black box: %s", error)
            return
        if helper.stdin:
            helper.stdin.close()
        if missed := self._unheard:
            self._unheard = ""
            self.tell(missed)

    def close(self, *, orderly: bool) -> None:
        """Let the helper end; wait for a log that it still writes, after a fault not for long: the
        helper goes on alone, and what it cannot end is saved at the next start."""
        if self._helper and self._helper.stdin:
            if orderly:
                self.tell(_ENDED.decode().strip())
            self._helper.stdin.close()
            try:
                self._helper.wait(_PATIENCE_S if orderly else FAULTED_PATIENCE_S)
            except subprocess.TimeoutExpired:
                _log.warning("the black box is still being written")
        if self.ring:
            self.ring.close()


def _start_helper(path: Path, directory: Path) -> "subprocess.Popen[bytes]":
    # -P: the working directory is nobody's module path. A session of its own: Ctrl-C is not for it.
    command = [sys.executable, "-P", "-m", "daemon.service.black_box", str(path), str(directory)]
    helper = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True, bufsize=0)
    assert helper.stdin is not None
    os.set_blocking(helper.stdin.fileno(), False)
    return helper


# --- the helper's side --------------------------------------------------------------------------


def follow(path: Path, directory: Path, pipe: int, tell: Callable[[str], None]) -> None:
    """Write a log after every fault, and after a death, until the pipe ends. Raises LogError."""
    with open_regular(path, follow=False) as ring:
        # Whoever finds the ring locked knows that it is being looked after.
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
                tell(f"black box: {saved}")
        _remove(path, ring)


def _alive(heard: bytes) -> bool:
    """True if the daemon goes on after it sent `heard`."""
    return bool(heard) and not heard.endswith(_ENDED)


def _faults(heard: bytes) -> list[tuple[float, str]]:
    """Faults that the daemon told of just now."""
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
    """Write what the frames of `log` mean beside it, if the daemon of the ring said so. A log
    without is still a log: what goes wrong is said."""
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

    Nothing half-written gets that name, and no file is overwritten. Raises LogError.
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
        # `error` itself may name the partial file, which is nobody's business.
        why = getattr(error, "strerror", None) or error
        raise LogError(f"cannot write {target}: {why}") from error
    return target


def save_left_over(path: Path, directory: Path, patience_s: float = _PATIENCE_S) -> Path | None:
    """Save the frames that a dead daemon left and no helper saves, and remove the ring; returns the
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
