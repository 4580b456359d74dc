"""Background readers of the daemon's stream: into a recording, and into a list of States."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from common.errors import ContactdError, ControlError, LogError
from daemon.protocol.state import State
from programs.clients import recorder
from programs.clients.client import Client


@contextmanager
def collecting(
    connect: Callable[[], Client], settled: Callable[[list[State]], bool]
) -> Iterator[list[State]]:
    """Growing list of all States while the block runs, which starts once they are `settled`. Raises
    UnreachableError."""
    seen: list[State] = []
    ended = threading.Event()
    failures: list[ContactdError] = []

    def follow() -> None:
        try:
            with connect() as reader:
                for state in reader.subscribe()[1]:
                    seen.append(state)
                    if ended.is_set():
                        return
        except ContactdError as error:
            failures.append(error)

    thread = threading.Thread(target=follow, name="watch")
    thread.start()
    try:
        while thread.is_alive() and not settled(seen):
            time.sleep(0.01)
        if not failures:
            yield seen
    finally:
        ended.set()
        thread.join()
    if failures:
        raise failures[0]


@contextmanager
def recording(
    connect: Callable[[], Client], path: Path, say: Callable[[str], None]
) -> Iterator[Sequence[ContactdError]]:
    """Record while the block runs; yields a growing list of failures. Deletes the recording if the
    motion was refused or nothing could be written. Raises LogError, ContactdError."""
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise LogError(f"cannot record in {path.parent}: {error.strerror}") from error
    ended = threading.Event()
    failures: list[ContactdError] = []

    def work() -> None:
        try:
            made = recorder.record(connect, path, stop=ended.is_set)
            if made.lost:
                say(f"{made.lost} ticks were not recorded: this computer is overloaded")
        except ContactdError as error:
            failures.append(error)

    thread = threading.Thread(target=work, name="recorder")
    thread.start()
    deadline = time.monotonic() + 2.0
    while not path.exists() and thread.is_alive() and time.monotonic() < deadline:
        time.sleep(0.01)
    if failures:
        raise failures[0]
    refused = False
    try:
        yield failures
    except ControlError:
        refused = True
        raise
    finally:
        ended.set()
        thread.join()
        if refused or (failures and path.exists() and not path.stat().st_size):
            path.unlink(missing_ok=True)
    if failures:
        raise failures[0]
