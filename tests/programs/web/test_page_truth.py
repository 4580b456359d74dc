"""The page in a real browser: STOP, and the truth about the picture."""

import signal
import socket
import threading
import time
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
from tests.programs.web.network import Network, network
from tests.programs.web.page_server import Page, page_of
from tests.programs.web.screens import AXE, PHONE, TIMEOUT_MS, Screens

FakeDaemon = Any  # of tests/fake_daemon.py

ARMED = {
    "mode": Mode.TRACKING,
    "armed": True,
    "permit": Permit(uid=0, pid=7, detached=True, left_s=552.0),
}


@pytest.mark.parametrize("by", ["finger", "key"])
def test_stop_says_that_it_stands(screens: Screens, arm: FakeDaemon, page: Page, by: str) -> None:
    arm.modes = {"stop": ["stopping", "holding"]}
    screen = screens.open(f"{page.url}?scene=off", PHONE)
    screen.live()
    if by == "finger":
        screen.page.click("#stop")
    else:
        screen.page.focus("#filter [name=text]")
        screen.page.keyboard.press("Escape")
    screen.shows("#outcome", "It stands")
    screen.picture(f"stands_{by}")
    assert [name for name, _ in arm.seen].count("stop") == 1


def test_stop_works_while_the_picture_is_old(screens: Screens, arm: FakeDaemon, page: Page) -> None:
    screen = screens.open(f"{page.url}?scene=off", PHONE)
    screen.live()
    arm.states = lambda tick: None  # the stream stands still, the door is open
    screen.old()
    screen.page.click("#stop")
    screen.until("document.querySelector('#outcome').innerText.length > 12")
    assert "stop" in [name for name, _ in arm.seen]


def test_a_frozen_server_is_old_and_not_reached_and_comes_back(
    screens: Screens, arm: FakeDaemon, page: Page
) -> None:
    """The WebSocket is open, and brings nothing."""
    screen = screens.open(f"{page.url}?scene=off", PHONE, "dark")
    screen.live()
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


def test_a_daemon_that_is_gone_is_said_and_comes_back(
    screens: Screens, arm: FakeDaemon, page: Page
) -> None:
    screen = screens.open(f"{page.url}?scene=off")
    screen.live()
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


def test_what_arming_needs_and_what_joints_sense_is_of_the_past_where_nothing_is_live(
    screens: Screens, arm: FakeDaemon, page: Page
) -> None:
    arm.changes = ARMED | {"drives": ["running"] * 7}  # as RobStride motors have it
    screen = screens.open(f"{page.url}?scene=off")
    screen.live()
    screen.begins("#arming-note", "It is armed.")
    screen.reads(".joint .state", "✓ sensing")
    arm.states = lambda tick: None
    screen.old()
    screen.until(
        "document.querySelector('#arming-note').innerText.startsWith('It was armed. To arm')"
    )
    screen.reads(".joint .state", "◌ was sensing")
    screen.begins(".joint .torque", "was ")
    screen.until("document.querySelector('.joint .bar').ariaValueText.startsWith('was ')")
    screen.until("/[0-9] s old/.test(document.querySelector('#loop').innerText)")


def test_a_silent_daemon_that_is_asked_again_leaves_the_cards_as_they_were(
    screens: Screens, arm: FakeDaemon, page: Page
) -> None:
    """The page's server connects anew to a daemon that answers, and publishes nothing."""
    arm.changes = ARMED
    screen = screens.open(f"{page.url}?scene=off")
    screen.live()
    screen.until("document.querySelector('.joint .torque').innerText.endsWith(' Nm')")
    arm.states = lambda tick: None
    before = [name for name, _ in arm.seen].count("subscribe")
    screen.old()
    deadline = time.monotonic() + TIMEOUT_MS / 1e3
    while [name for name, _ in arm.seen].count("subscribe") < before + 2:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    screen.begins(".joint .torque", "was ")


def test_a_page_opened_after_the_daemon_died_says_what_passed_then(
    screens: Screens, arm: FakeDaemon, page: Page
) -> None:
    arm.changes = {**ARMED, "armed": False, "permit": None, "mode": Mode.HOLDING}
    screen = screens.open(f"{page.url}?scene=off")
    screen.live()
    live = "2 of 3 checks fail: arming would be refused."
    screen.until(f"document.querySelector('#arming-note').innerText === '{live}'")
    with gone(arm):
        screen.old()
        screen.page.reload()
        screen.shows("#arming-note", "then")
        screen.reads("#arming-note", "2 of 3 checks failed then:")


def test_a_fault_that_ended_the_daemon_says_what_to_do(
    screens: Screens, arm: FakeDaemon, page: Page
) -> None:
    screen = screens.open(f"{page.url}?scene=off", PHONE)
    screen.live()
    arm.changes = {"mode": Mode.FAULTED, "cause": "bus off: can0", "permit": None}
    screen.shows("#fault-cause", "bus off")
    with gone(arm):
        screen.old()
        screen.reads("#fault-cause", "It was a fault: bus off: can0")
        section = SECTION_OF[Condition.BUS_OFF]
        advice = f"{TABLE[Condition.BUS_OFF].advice}; more: {section.replace('-', ' ')}"
        screen.shows("#fault-advice", advice.replace("`", ""))
        screen.picture("ended")
        with screen.page.expect_popup() as opened:
            screen.page.click("#fault-advice a")
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
    """A phone goes from one access point to another: none of its connections ever says a word
    again, and none is closed. A stop must not go into one of them."""
    bad, url = roaming
    arm.modes = {"stop": ["holding"]}
    screen = screens.open(url, PHONE)
    screen.live()
    bad.lose()
    screen.page.click("#stop")
    screen.until("document.querySelector('#outcome').dataset.outcome === 'stands'")
    assert [name for name, _ in arm.seen].count("stop") == 1
    screen.live()  # by a new stream


def test_a_network_that_is_too_slow_is_said_and_stop_works(
    screens: Screens, arm: FakeDaemon, roaming: tuple[Network, str]
) -> None:
    bad, url = roaming
    arm.modes = {"stop": ["holding"]}
    screen = screens.open(url, PHONE)
    screen.live()
    bad.bytes_per_s = 5000.0
    screen.shows("#connection", "too slow")
    # What was still on its way may be of just now.
    screen.begins("#live", "◌ not live")
    screen.picture("slow")
    screen.page.click("#stop")
    screen.until("document.querySelector('#outcome').dataset.outcome === 'stands'")
    bad.bytes_per_s = float("inf")
    screen.live()


@contextmanager
def gone(arm: FakeDaemon) -> Iterator[None]:
    """While the block lasts the daemon is dead, and its sockets with it; then it is another."""
    arm.stopped.set()
    deadline = time.monotonic() + TIMEOUT_MS / 1e3
    while arm.path.exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    yield
    arm.stopped.clear()
    again = threading.Thread(target=arm.run, daemon=True)
    again.start()
