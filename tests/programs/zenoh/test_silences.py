"""Arming over Zenoh ends by itself, whichever process or network falls silent, and what was kept on
the way arms nothing."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest

from bench.rigs.served_daemon import ServedDaemon
from tests.programs.zenoh.bridge import until
from tests.programs.zenoh.silences import SILENCES, Way, way_to


@pytest.fixture
def running(served: ServedDaemon) -> Iterator[ServedDaemon]:
    """The daemon, whose time passes as on a clock, or more slowly where the machine is busy."""
    served.rig.enable()
    ended = threading.Event()

    def run() -> None:
        while not ended.is_set():
            served.tick()
            time.sleep(0.01)

    thread = threading.Thread(target=run)
    thread.start()
    yield served
    ended.set()
    thread.join()


@pytest.mark.parametrize("silence", SILENCES.values(), ids=SILENCES)
def test_silence_ends_the_hold(running: ServedDaemon, silence: Callable[[Way], None]) -> None:
    machine = running.rig.tick.controller.machine
    with way_to(running.path) as way:
        until(lambda: machine.armed)
        silence(way)
        until(lambda: not machine.armed)
        way.caller.kill()
        way.go_on()
        for _ in range(50):
            assert not machine.armed
            time.sleep(0.01)
