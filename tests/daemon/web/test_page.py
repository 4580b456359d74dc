"""The page in a real browser: what a person sees, in every state, on a phone and on a wall.

Pictures of all states go to build/page. Any error in the browser's console fails a test, a
violation of the content security policy among them.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from bench.rigs.browser import browser, chromium
from bench.rigs.lockstep import ROMEO
from bench.rigs.page import Page, page_of
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.clients.client import Client
from daemon.modes.table import Mode
from daemon.protocol.messages import Permit, Request, State
from simulator.hand import Guide, Push, Release

ROOT = Path(__file__).resolve().parents[3]
PICTURES = ROOT / "build/page"
AXE = ROOT / "page/node_modules/axe-core/axe.min.js"
# That of the third experiment, sooner: times after the arm's first motion.
HAND = (
    Push(at_s=4.0, joint="LShoulderPitch", torque=-2.5, duration_s=0.4, shape="ramp"),
    Guide(
        at_s=4.4,
        to={"LShoulderPitch": 0.6, "LElbowYaw": -0.8},
        speed=0.25,
        stiffness=40,
        damping=2,
        max_torque=4,
    ),
    Release(at_s=9.0),
)
PATIENCE_MS = 60_000  # of what comes at once on a machine that has nothing else to do
DESKTOP, PHONE, WALL = (1440, 900), (360, 740), (3840, 2160)
GONE = "ERR_"  # what a browser says of a server that is gone, when a test took it away
FakeDaemon = Any  # of tests/daemon/conftest.py, which nothing imports

pytestmark = pytest.mark.skipif(
    chromium() is None, reason="NOT TRIED: no chromium here (apt install chromium)"
)


@dataclass
class Screen:
    """One page in the browser, and what went wrong in it."""

    page: Any
    errors: list[str] = field(default_factory=list)

    def until(self, script: str) -> None:
        """Wait until an expression is true in the page."""
        self.page.wait_for_function(f"() => {script}", timeout=PATIENCE_MS)

    def text(self, selector: str) -> str:
        return str(self.page.inner_text(selector))

    def live(self) -> None:
        self.until("!document.body.classList.contains('stale')")

    def old(self) -> None:
        self.until("document.body.classList.contains('stale')")

    def picture(self, name: str) -> None:
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=PICTURES / f"{name}.png")

    def faults_of_access(self) -> list[str]:
        """What axe finds that is serious or critical."""
        if not AXE.exists():
            pytest.skip("NOT TRIED: page/node_modules is not there (make web)")
        self.page.evaluate(AXE.read_text())
        found = self.page.evaluate("axe.run().then((result) => result.violations)")
        return [
            f"{one['id']}: {one['nodes'][0]['html'][:120]}"
            for one in found
            if one["impact"] in ("serious", "critical")
        ]


class Screens:
    """Opens pages in one browser, and sees at the end that nothing went wrong in them."""

    def __init__(self, launched: Any) -> None:
        self._browser = launched
        self._opened: list[Screen] = []

    def open(self, url: str, size: tuple[int, int] = DESKTOP, scheme: str = "light") -> Screen:
        viewport = {"width": size[0], "height": size[1]}
        context = self._browser.new_context(viewport=viewport, color_scheme=scheme)
        screen = Screen(context.new_page())
        screen.page.on("pageerror", lambda error: screen.errors.append(str(error)))
        screen.page.on(
            "console",
            lambda said: screen.errors.append(said.text) if said.type == "error" else None,
        )
        screen.page.goto(url)
        self._opened.append(screen)
        return screen

    def close(self) -> list[str]:
        errors = [error for screen in self._opened for error in screen.errors if GONE not in error]
        for screen in self._opened:
            screen.page.context.close()
        self._opened.clear()
        return errors


@pytest.fixture(scope="module")
def launched() -> Iterator[Any]:
    with browser() as one:
        yield one


@pytest.fixture
def screens(launched: Any) -> Iterator[Screens]:
    opened = Screens(launched)
    yield opened
    assert opened.close() == []


@pytest.fixture
def arm(fake_daemon: FakeDaemon, make_state: Callable[..., State]) -> FakeDaemon:
    """A daemon that publishes what a test says, at about 100 Hz, by the machine's own clock."""
    begun = time.monotonic()
    fake_daemon.changes = {}

    def state(tick: int) -> State | None:
        if tick % 10:
            return None
        made = make_state(tick // 10)
        now = time.monotonic()
        timing = replace(made.timing, monotonic_s=now, wall_s=time.time())
        said = {"time_s": now - begun, "timing": timing, **fake_daemon.changes}
        return replace(made, **said)

    fake_daemon.states = state
    return fake_daemon


@pytest.fixture
def page(arm: FakeDaemon) -> Iterator[Page]:
    with page_of(arm.path) as one:
        yield one


ARMED = {
    "mode": Mode.TRACKING,
    "armed": True,
    "cause": "start by uid 0 (pid 7)",
    "permit": Permit(uid=0, pid=7, detached=True, left_s=552.0),
}
FAULTED = {
    "mode": Mode.FAULTED,
    "armed": False,
    "cause": "drive does not follow: LElbowRoll",
    "unproved": ["LElbowRoll"],
    "permit": None,
}


# --- what a person sees -----------------------------------------------------------------------


SIZES = (
    ("phone", PHONE, "light"),
    ("phone_dark", PHONE, "dark"),
    ("desktop", DESKTOP, "light"),
    ("desktop_dark", DESKTOP, "dark"),
    ("wall", WALL, "dark"),
)


@pytest.mark.parametrize(
    ("state", "changes", "sizes"), [("armed", ARMED, SIZES), ("fault", FAULTED, SIZES[1:3])]
)
def test_every_size_shows_what_matters(
    screens: Screens,
    arm: FakeDaemon,
    page: Page,
    state: str,
    changes: dict[str, Any],
    sizes: tuple[tuple[str, tuple[int, int], str], ...],
) -> None:
    arm.changes = changes
    for name, size, scheme in sizes:
        screen = screens.open(f"{page.url}?scene=off", size, scheme)
        screen.live()
        screen.until("document.documentElement.scrollWidth <= innerWidth")
        if state == "armed":
            assert "tracking" in screen.text("#mode")
            armed = "ARMED by root for another 9 min 12 s"
            screen.until(f"document.querySelector('#permit').innerText.startsWith('{armed}')")
            assert "start by uid 0" in screen.text("#cause")
            assert not screen.page.is_visible("#fault")
        else:
            assert screen.text("#permit") == "not armed"
            assert "Fault: drive does not follow: LElbowRoll" in screen.text("#fault")
            assert "Not seen to stand: LElbowRoll." in screen.text("#fault")
            assert screen.page.locator(".state[data-kind=bad]").count() == 1
        for button in ("#stop", "#disarm"):
            box = screen.page.locator(button).bounding_box()
            assert 0 <= box["x"] <= box["x"] + box["width"] <= size[0]
            assert 0 <= box["y"] <= box["y"] + box["height"] <= size[1]
            assert box["height"] >= 44
        screen.picture(f"{state}_{name}")
        if name.startswith("desktop"):
            screen.until("document.querySelector('#checks li')")
            assert screen.faults_of_access() == []
        screen.page.close()


def test_markup_from_an_arm_stays_text(screens: Screens, arm: FakeDaemon, page: Page) -> None:
    text = "<img src=x onerror=alert(1)><b>fault</b>"
    arm.changes = {**FAULTED, "cause": text}
    screen = screens.open(f"{page.url}?scene=off")
    screen.live()
    assert text in screen.text("#fault-cause")
    assert screen.page.locator("img").count() == 0


def test_several_arms_are_tabs(screens: Screens, arm: FakeDaemon, tmp_path: Path) -> None:
    arm.changes = ARMED
    with page_of(arm.path, tmp_path / "other.sock") as both:
        screen = screens.open(f"{both.url}?scene=off")
        screen.live()
        screen.until("document.querySelectorAll('#tabs a').length === 2")
        screen.until("document.querySelector('#tabs').innerText.includes('tracking, armed')")
        assert "no connection" in screen.text("#tabs")
        screen.picture("tabs")
        screen.page.click("#tabs a:nth-child(2)")
        screen.until("document.querySelector('#connection').innerText.includes('other-view.sock')")
        assert screen.text("#mode") == "no connection"
        screen.picture("gone")


def test_read_only_has_no_buttons(screens: Screens, arm: FakeDaemon) -> None:
    with page_of(arm.path, options=("--read-only", "--no-recordings")) as shown:
        screen = screens.open(f"{shown.url}?scene=off")
        screen.live()
        assert not screen.page.is_visible("#stop")
        screen.page.keyboard.press("Escape")
    assert "stop" not in [name for name, _ in arm.seen]


def test_the_token_is_typed_once(screens: Screens, arm: FakeDaemon, tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("0123456789abcdef")
    token.chmod(0o600)
    with page_of(arm.path, options=("--token-file", str(token), "--no-recordings")) as asking:
        screen = screens.open(asking.url)
        screen.page.fill("input", "0123456789abcdeg")
        screen.page.click("button")
        screen.until("document.querySelector('[role=alert]') !== null")
        assert screen.text("[role=alert]") == "That is not the token."
        screen.picture("token")
        screen.errors.clear()  # the browser tells of the 401
        screen.page.fill("input", "0123456789abcdef")
        screen.page.click("button")
        screen.live()
        screen.page.reload()
        screen.live()


def test_events_are_filtered(screens: Screens, arm: FakeDaemon, page: Page) -> None:
    screen = screens.open(f"{page.url}?scene=off")
    screen.until("document.querySelectorAll('#events li[data-kind=contact]').length")
    screen.page.uncheck("#filter [name=contact]")
    screen.until("!document.querySelectorAll('#events li[data-kind]').length")
    screen.page.check("#filter [name=contact]")
    screen.page.fill("#filter [name=text]", "nothing like it")
    screen.until("document.querySelector('#events').innerText.includes('None of them')")


def test_a_recording_from_the_page(screens: Screens, arm: FakeDaemon, tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    with page_of(arm.path, options=("--recordings", str(folder))) as recording:
        screen = screens.open(f"{recording.url}?scene=off")
        screen.live()
        screen.page.click("#record")
        screen.until("document.querySelector('#record').innerText.includes('End')")
        screen.page.click("#record")
        screen.until("document.querySelectorAll('#recordings a').length === 1")
        with screen.page.expect_download() as download:
            screen.page.click("#recordings a")
        assert Path(download.value.path()).read_bytes().startswith(b"\x89MCAP")
        screen.page.locator("#recordings button").click()
        screen.page.locator("#recordings button").click()
        screen.until("document.querySelectorAll('#recordings a').length === 0")
    assert list(folder.iterdir()) == []


# --- stop, and the truth about the picture ----------------------------------------------------


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
    screen.until("document.querySelector('#outcome').innerText.includes('It stands')")
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
        assert screen.text("#mode").startswith("was ")
        screen.page.click("#stop")
        screen.until("document.querySelector('#outcome').innerText.includes('NOT REACHED')")
        assert "use the emergency stop" in screen.text("#outcome")
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
        screen.until("document.querySelector('#connection').innerText.includes('No connection')")
        assert screen.text("#mode").startswith("was ")
        assert screen.text("#permit").startswith("was ")
        screen.picture("stale")
    screen.live()
    assert not screen.text("#mode").startswith("was ")


@contextmanager
def gone(arm: FakeDaemon) -> Iterator[None]:
    """While the block lasts the daemon is dead, and its sockets with it; then it is another."""
    arm.stopped.set()
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while arm.path.exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    yield
    arm.stopped.clear()
    again = threading.Thread(target=arm.run, daemon=True)
    again.start()


# --- the whole way: simulated arm, daemon, server, browser ------------------------------------


@dataclass
class Robot:
    """Arm and daemon in lockstep, ticked by a thread at the machine's pace, however slow: no tick
    is late, and what a State says of its own time is this machine's."""

    served: ServedDaemon
    frozen: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        control = self.served.service.control
        publish = control.publish

        def publish_now(state: State) -> None:
            now = {"monotonic_s": time.monotonic(), "wall_s": time.time()}
            publish(replace(state, timing=replace(state.timing, **now)))

        control.publish = publish_now  # type: ignore[method-assign]
        while not self.ended.is_set():
            begun_s = time.monotonic()
            if not self.frozen.is_set():
                self.served.tick()
            time.sleep(max(0.01 - (time.monotonic() - begun_s), 0.0))


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with served_daemon(tmp_path, ROMEO, hand=HAND) as served:
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
        Client(robot.served.path, PATIENCE_MS / 1e3) as person,
    ):
        screen = screens.open(f"{shown.url}?scene=on", (1000, 800))
        phone = screens.open(f"{shown.url}?scene=off", PHONE)
        screen.live()
        screen.until(mode("off"))
        assert person.request("enable").ok
        screen.until(mode("holding"))
        arm_it(person)
        screen.until("document.querySelector('#permit').innerText.includes('on behalf of a test')")
        assert person.request("start").ok
        screen.until(mode("yielding"))
        screen.until("document.querySelectorAll('.joint.beyond').length > 0")
        screen.until("Number(document.querySelector('#scene').dataset.arrows) > 0")
        screen.until("document.querySelector('#scene').dataset.lit !== ''")
        screen.picture("story_yielding")
        screen.until("document.querySelector('#events li[data-kind=contact]') !== null")
        assert "LShoulderPitch" in screen.text("#events")
        screen.until(mode("tracking"))
        phone.live()
        phone.page.click("#stop")
        phone.until("document.querySelector('#outcome').innerText.length > 12")
        phone.until(mode("holding"))
        phone.picture("story_stopped")
        status = person.ask_status()
        assert (status.mode, status.armed) == (Mode.HOLDING, False)
        assert "on behalf of the page at 127.0.0.1" in status.cause
        assert phone.text("#permit").startswith("not armed")
        robot.frozen.set()
        screen.old()
        screen.until("document.querySelector('#connection').innerText.includes('No connection')")
        robot.frozen.clear()
        screen.live()


def mode(word: str) -> str:
    return f"document.querySelector('#mode').innerText.includes('{word}')"


def arm_it(person: Client) -> None:
    """Arm, as soon as all checks pass; the lease outlives the connection."""
    request = Request("arm", lease_s=600.0, detached=True, on_behalf_of="a test")
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while not (reply := person.ask(request)).ok:
        assert time.monotonic() < deadline, reply.refusal
        time.sleep(0.2)
