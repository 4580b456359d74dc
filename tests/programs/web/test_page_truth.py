"""The page in a real browser: STOP, and values that are not live shown as old."""

import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from daemon.faults.conditions import Condition
from daemon.faults.symptoms import SECTION_OF
from daemon.faults.table import TABLE
from daemon.modes.table import Mode
from daemon.protocol.state import Permit
from programs.clients.waiting import asked_until
from tests.programs.web.network import Network, network
from tests.programs.web.page_server import Page, page_of
from tests.programs.web.screens import AXE, PHONE, TIMEOUT_MS, Screen, Screens

FakeDaemon = Any  # of tests/fake_daemon.py

ARMED = {
    "mode": Mode.TRACKING,
    "armed": True,
    "permit": Permit(uid=0, pid=7, detached=True, left_s=552.0),
}


def times(arm: FakeDaemon, command: str) -> int:
    """Number of times that the daemon was asked this."""
    return [name for name, _ in arm.seen].count(command)


@pytest.mark.parametrize("by", ["finger", "key"])
def test_stop_shows_that_it_stands(phone: Screen, arm: FakeDaemon, by: str) -> None:
    arm.modes = {"stop": ["stopping", "holding"]}
    if by == "finger":
        phone.page.click("#stop")
    else:
        phone.page.focus("#filter [name=text]")
        phone.page.keyboard.press("Escape")
    phone.shows("#outcome", "It stands")
    phone.picture(f"stands_{by}")
    assert times(arm, "stop") == 1


def test_stop_works_while_the_picture_is_old(phone: Screen, arm: FakeDaemon) -> None:
    arm.states = lambda tick: None  # no States come, but requests are answered
    phone.old()
    phone.page.click("#stop")
    phone.until("document.querySelector('#outcome').innerText.length > 12")
    assert times(arm, "stop")


def test_a_frozen_server_is_old_and_not_reached_and_comes_back(
    screens: Screens, arm: FakeDaemon, page: Page
) -> None:
    """The WebSocket is open, and brings nothing."""
    screen = screens.live(f"{page.url}?scene=off", PHONE, "dark")
    page.process.send_signal(signal.SIGSTOP)
    try:
        screen.old()
        screen.begins("#mode", "was ")
        screen.page.click("#stop")
        screen.shows("#outcome", "NOT REACHED")
        screen.shows("#outcome", "use the emergency stop")
        screen.picture("not_reached")
    finally:
        page.process.send_signal(signal.SIGCONT)
    screen.live()


def test_a_daemon_that_is_gone_is_reported_and_comes_back(screen: Screen, arm: FakeDaemon) -> None:
    with gone(arm):
        screen.old()
        screen.shows("#connection", "No connection")
        screen.begins("#mode", "was ")
        screen.begins("#permit", "was ")
        screen.begins("#live", "◌ not live, as of ")
        screen.begins("#felt", "Detected then: ")
        screen.picture("stale")
    screen.live()
    screen.until("!document.querySelector('#mode').innerText.startsWith('was ')")


def test_arming_and_sensing_are_in_the_past_tense_where_nothing_is_live(
    screen: Screen, arm: FakeDaemon
) -> None:
    arm.changes = ARMED | {"drives": ["running"] * 7}  # as RobStride motors have it
    screen.begins("#arming-note", "It is armed.")
    screen.reads(".joint .state", "✓ sensing")
    arm.states = lambda tick: None
    screen.old()
    screen.begins("#arming-note", "It was armed. To arm")
    screen.reads(".joint .state", "◌ was sensing")
    screen.begins(".joint .torque", "was ")
    screen.until("document.querySelector('.joint .bar').ariaValueText.startsWith('was ')")
    screen.until("/[0-9] s old/.test(document.querySelector('#loop').innerText)")


def test_a_silent_daemon_that_is_asked_again_leaves_the_cards_as_they_were(
    screen: Screen, arm: FakeDaemon
) -> None:
    """The page's server connects anew to a daemon that answers, and publishes nothing."""
    arm.changes = ARMED
    screen.until("document.querySelector('.joint .torque').innerText.endsWith(' Nm')")
    arm.states = lambda tick: None
    before = times(arm, "subscribe")
    screen.old()
    again = before + 2
    now = asked_until(lambda: times(arm, "subscribe"), lambda n: n >= again, TIMEOUT_MS / 1e3)
    assert now >= again
    screen.begins(".joint .torque", "was ")


def test_a_page_opened_after_the_daemon_died_shows_the_checks_of_then(
    screen: Screen, arm: FakeDaemon
) -> None:
    arm.changes = {**ARMED, "armed": False, "permit": None, "mode": Mode.HOLDING}
    screen.reads("#arming-note", "2 of 3 checks fail: arming would be refused.")
    with gone(arm):
        screen.old()
        screen.page.reload()
        screen.shows("#arming-note", "then")
        screen.reads("#arming-note", "2 of 3 checks failed then:")


def test_a_fault_that_ended_the_daemon_shows_its_advice(phone: Screen, arm: FakeDaemon) -> None:
    arm.changes = {"mode": Mode.FAULTED, "cause": "bus off: can0", "permit": None}
    phone.shows("#fault-cause", "bus off")
    with gone(arm):
        phone.old()
        phone.reads("#fault-cause", "It was a fault: bus off: can0")
        section = SECTION_OF[Condition.BUS_OFF]
        advice = f"{TABLE[Condition.BUS_OFF].advice}; more: {section.replace('-', ' ')}"
        phone.shows("#fault-advice", advice.replace("`", ""))
        phone.picture("ended")
        with phone.page.expect_popup() as opened:
            phone.page.click("#fault-advice a")
        more = opened.value
        assert more.url.endswith(f"/troubleshooting.html#{section}")
        assert more.inner_text(":target") == "A drive falls silent"


@pytest.mark.skipif(not AXE.exists(), reason="NOT TRIED: page/node_modules is not there (make web)")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_that_a_fault_links_to_can_be_read_by_all(
    screens: Screens, page: Page, scheme: str
) -> None:
    screen = screens.open(f"{page.url}troubleshooting.html#it-presses", PHONE, scheme)
    assert screen.faults_of_access() == []
    screen.picture(f"troubleshooting_{scheme}")


@pytest.fixture
def roaming(arm: FakeDaemon, tmp_path: Path) -> Iterator[tuple[Network, str]]:
    """The page behind a network that may be bad, and its address there."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        free = int(probe.getsockname()[1])
    with network(free) as bad:
        options = ("--port", str(free), "--host", f"127.0.0.1:{bad.port}")
        recordings = ("--recordings", str(tmp_path / "recordings"))
        with page_of(arm.path, options=(*options, *recordings)):
            yield bad, f"http://127.0.0.1:{bad.port}/?scene=off"


def test_stop_is_reached_at_once_after_every_connection_was_lost(
    screens: Screens, arm: FakeDaemon, roaming: tuple[Network, str]
) -> None:
    """A phone goes from one access point to another: nothing comes on its connections any more,
    and none is closed. A stop must not go into one of them."""
    bad, url = roaming
    arm.modes = {"stop": ["holding"]}
    screen = screens.live(url, PHONE)
    bad.lose()
    screen.page.click("#stop")
    screen.data("#outcome", "outcome", "stands")
    assert times(arm, "stop") == 1
    screen.live()  # by a new stream


def test_a_network_that_is_too_slow_is_reported_and_stop_works(
    screens: Screens, arm: FakeDaemon, roaming: tuple[Network, str]
) -> None:
    bad, url = roaming
    arm.modes = {"stop": ["holding"]}
    screen = screens.live(url, PHONE)
    bad.bytes_per_s = 5000.0
    screen.shows("#connection", "too slow")
    # What was still on its way may be of just now.
    screen.begins("#live", "◌ not live")
    screen.picture("slow")
    screen.page.click("#stop")
    screen.data("#outcome", "outcome", "stands")
    bad.bytes_per_s = float("inf")
    screen.live()


@contextmanager
def gone(arm: FakeDaemon) -> Iterator[None]:
    """A daemon that is ended, with its sockets, while the block lasts; then another begins."""
    arm.stopped.set()
    assert not asked_until(arm.path.exists, lambda there: not there, TIMEOUT_MS / 1e3)
    yield
    arm.stopped.clear()
    again = threading.Thread(target=arm.run, daemon=True)
    again.start()
