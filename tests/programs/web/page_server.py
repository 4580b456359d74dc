"""The page's server as a process, `contactd-web`, for tests."""

import contextlib
import re
import struct
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from contactd_client.paths import view_socket_path
from programs.web import frames

TIMEOUT_S = 30.0


@dataclass(frozen=True, slots=True)
class Page:
    """Running server, and the address that it printed."""

    process: subprocess.Popen[str]
    url: str


@contextlib.contextmanager
def page_of(
    *control_sockets: Path, options: tuple[str, ...] = ("--no-recordings",)
) -> Iterator[Page]:
    """The page of the daemons at these control sockets, at a free port, while the context lasts."""
    views = [str(view_socket_path(path)) for path in control_sockets]
    command = [sys.executable, "-m", "programs.web.contactd_web", "--port", "0"]
    with subprocess.Popen(
        [*command, *options, *views], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            said = process.stdout.readline()
            found = re.search(r"http://\S+", said)
            if found is None:
                raise RuntimeError(f"the page does not start: {said!r}")
            yield Page(process, found.group(0))
        finally:
            process.terminate()
            try:
                process.wait(TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()


def ticks_in(message: bytes) -> list[int]:
    """Ticks of a binary message of the stream that are live; none of those that were."""
    found: list[int] = []
    begin = 0
    while begin < len(message):
        (length,) = struct.unpack_from("<I", message, begin)
        _, past, joints, count, *_ = frames.HEADER.unpack_from(message, begin + 4)
        padded = joints + -joints % 4
        size = frames.TICK.size + padded + 4 * len(frames.VECTORS) * joints
        first = begin + 4 + frames.HEADER.size
        if not past:
            found += [struct.unpack_from("<I", message, first + i * size)[0] for i in range(count)]
        begin += 4 + length
    return found
