"""The page in a real browser, the whole way: simulated arm, daemon, server, browser."""

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from msgspec.structs import replace

from bench.rigs.lockstep import ROMEO
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.modes.table import Mode
from daemon.protocol.requests import Arm
from daemon.protocol.state import State
from programs.clients.client import Client
from simulator.hand_script import Guide, Push, Release
from tests.programs.web.page_server import page_of
from tests.programs.web.screens import PHONE, TIMEOUT_MS, Screens

# Those of the third experiment, when they are asked for.
HAND = (
    Push(at_s=0.0, joint="LShoulderPitch", torque=-2.5, duration_s=0.4, shape="ramp"),
    Guide(
        at_s=0.0,
        to={"LShoulderPitch": 0.6, "LElbowYaw": -0.8},
        speed=0.25,
        stiffness=40,
        damping=2,
        max_torque=4,
    ),
)


@dataclass
class Robot:
    """Arm and daemon in lockstep, ticked by a thread at the machine's pace, however slow: no tick
    is late, and what a State says of its own time is this machine's. In `slow` motion the arm
    stands still in time at a contact, and its last State is published again: a busy machine's
    browser shows little of three seconds."""

    served: ServedDaemon
    frozen: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)
    slow: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        control = self.served.service.control
        publish = control.publish
        last: list[State] = []

        def publish_now(state: State) -> None:
            now = {"monotonic_s": time.monotonic(), "wall_s": time.time()}
            last[:] = [replace(state, notices=[])]
            publish(replace(state, timing=replace(state.timing, **now)))

        control.publish = publish_now  # type: ignore[method-assign]
        while not self.ended.is_set():
            begun_s = time.monotonic()
            if self.slow.is_set() and last and is_yielding(last[0]):
                publish_now(last[0])
            elif not self.frozen.is_set():
                self.served.tick()
            time.sleep(max(0.01 - (time.monotonic() - begun_s), 0.0))


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with served_daemon(tmp_path, ROMEO) as served:
        one = Robot(served)
        ticking = threading.Thread(target=one.run)
        ticking.start()
        yield one
        one.ended.set()
        ticking.join()


def test_the_story_is_seen_and_stopped_from_a_phone(screens: Screens, robot: Robot) -> None:
    """A hand pushes: link lit, curve over its level, mode changes. Then STOP, on a phone."""
    with (
        page_of(robot.served.path) as shown,
        Client(robot.served.path, TIMEOUT_MS / 1e3) as person,
    ):
        screen = screens.open(f"{shown.url}?scene=on", (1000, 800))
        phone = screens.open(f"{shown.url}?scene=off", PHONE)
        screen.live()
        screen.until(mode("off"))
        assert person.request("enable").ok
        screen.until(mode("holding"))
        arm_it(person)
        screen.shows("#permit", "on behalf of a test")
        robot.slow.set()
        assert person.request("start").ok
        screen.until(mode("tracking"))
        hand = robot.served.rig.arm.hand
        for act in HAND:
            hand.take(act)
        screen.until(mode("yielding"))
        screen.until("document.querySelectorAll('.joint.beyond').length > 0")
        screen.until("Number(document.querySelector('#scene').dataset.arrows) > 0")
        screen.until("document.querySelector('#scene').dataset.lit !== ''")
        screen.picture("story_yielding")
        screen.until("document.querySelector('#events li[data-kind=contact]') !== null")
        screen.shows("#events li[data-kind=contact]", "Nm (contact)")
        robot.slow.clear()
        hand.take(Release(at_s=0.0))
        screen.until(mode("tracking"))
        phone.live()
        phone.page.click("#stop")
        phone.until("document.querySelector('#outcome').innerText.length > 12")
        phone.until(mode("holding"))
        phone.picture("story_stopped")
        status = person.ask_status()
        assert (status.mode, status.armed) == (Mode.HOLDING, False)
        assert "on behalf of the page at 127.0.0.1" in status.cause
        phone.begins("#permit", "not armed")
        robot.frozen.set()
        screen.old()
        screen.shows("#connection", "No connection")
        robot.frozen.clear()
        screen.live()


def is_yielding(state: State) -> bool:
    return state.mode is Mode.ADMITTANCE and any(state.thresholded)


def mode(word: str) -> str:
    return f"document.querySelector('#mode').innerText.includes('{word}')"


def arm_it(person: Client) -> None:
    """Arm, as soon as all checks pass; the lease outlives the connection."""
    request = Arm(lease_s=600.0, detached=True, on_behalf_of="a test")
    deadline = time.monotonic() + TIMEOUT_MS / 1e3
    while not (reply := person.ask(request)).ok:
        assert time.monotonic() < deadline, reply.refusal
        time.sleep(0.2)
