"""Black box: the last minute of frames, written to a log after a fault by another process.

The daemon keeps the frames in a `FrameRing` beside its control socket. Before it goes real-time it
starts a helper, which holds the other end of a pipe and sleeps: a line on the pipe is a fault, and
its end is the daemon's death, of whatever cause. Either way the helper writes the ring to a log of
python-can in the state directory, with the context needed to read it: configuration, URDF, and the
faults (`Context`). An orderly end is announced, and leaves no log. Nor does a start that failed: it
has no minute of frames, and a day of such starts would displace the logs of real faults.
"""

import logging
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from common.errors import LogError
from daemon.protocol.doors import DOORS, Door
from daemon.protocol.socket_path import open_to_group
from daemon.service.black_box_log import ENDED, TIMEOUT_S, context_path, follow, save_left_over
from daemon.service.journal import log_to_stderr
from drivers.can.frame_ring import KEPT_S, FrameRing

# Room for emergencies and other frames on the bus.
MARGIN: Final = 1.2
# Shortest time between restarts of a helper that keeps dying.
HELPS_EVERY_S: Final = 10.0
#: Longest wait for the log when the daemon ends for a fault, as it is to be restarted soon [s].
FAULTED_TIMEOUT_S: Final = 1.0
_log = logging.getLogger("contactd")


def default_directory() -> Path:
    """Directory for logs: `$STATE_DIRECTORY` (systemd), else contactd's in the user's state."""
    if given := os.environ.get("STATE_DIRECTORY"):
        return Path(given.split(":")[0])
    home = os.environ.get("XDG_STATE_HOME")
    return (Path(home) if home else Path.home() / ".local" / "state") / "contactd"


def ring_path(socket: Path) -> Path:
    """Path of the ring of the daemon with this control socket: next to it, usually on a tmpfs."""
    return socket.with_name(f"{socket.name}.frames")


class BlackBox:
    """Daemon's side of the black box: a context, ended in order unless an exception leaves it."""

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
            save_left_over(path, directory, timeout_s=0.0)
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
        """Leave a log after any disorderly end from now on."""
        self._begun = True

    def report(self, fault: str) -> None:
        """Report a fault to the helper. Never waits: if the pipe is full, it already holds one."""
        if self._helper and self._helper.stdin:
            try:
                os.write(self._helper.stdin.fileno(), fault.encode()[:200] + b"\n")
            except BlockingIOError:
                pass
            except OSError:
                self._unheard = fault  # for the next helper: the frames are still there

    def look_after(self, now_s: float) -> None:
        """Restart the helper if it was killed, at most once in HELPS_EVERY_S, and report a fault
        that it missed; to be called periodically, between two ticks."""
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
                self.report(ENDED.decode().strip())
            self._helper.stdin.close()
            try:
                self._helper.wait(TIMEOUT_S if orderly else FAULTED_TIMEOUT_S)
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


if __name__ == "__main__":
    os.nice(10)
    with log_to_stderr():
        follow(Path(sys.argv[1]), Path(sys.argv[2]), sys.stdin.fileno(), _log.warning)
