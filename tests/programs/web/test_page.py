"""The page in a real browser: its texts and pictures in every state, on a phone and on a wall."""

import io
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from msgspec.structs import replace

from bench.rigs.generated_arms import Body, urdf_of
from bench.rigs.lockstep import ROMEO
from daemon.config.load import load_robot
from daemon.modes.table import Mode
from daemon.protocol.state import Meeting, Notice, Permit, Wrench
from tests.programs.clients.test_dashboard import STREAM
from tests.programs.recordings.test_touch_point import POSE, pushed
from tests.programs.web.page_server import Page, page_of
from tests.programs.web.screens import AXE, DESKTOP, PHONE, PICTURES, WALL, Screen, Screens

FakeDaemon = Any  # of tests/fake_daemon.py

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

SIZES = {
    "phone": (PHONE, "light"),
    "phone_dark": (PHONE, "dark"),
    "desktop": (DESKTOP, "light"),
    "desktop_dark": (DESKTOP, "dark"),
    "wall": (WALL, "dark"),
}


@pytest.mark.parametrize(("state", "names"), [("armed", list(SIZES)), ("fault", list(SIZES)[1:3])])
def test_every_size_shows_the_state_the_fault_and_the_buttons(
    screens: Screens, arm: FakeDaemon, page: Page, state: str, names: list[str]
) -> None:
    arm.changes = ARMED if state == "armed" else FAULTED
    for name in names:
        size, scheme = SIZES[name]
        screen = screens.live(f"{page.url}?scene=off", size, scheme)
        screen.until("document.documentElement.scrollWidth <= innerWidth")
        if state == "armed":
            screen.shows("#mode", "tracking")
            armed = "ARMED by root for another 9 min 12 s"
            screen.until(f"document.querySelector('#permit').innerText.startsWith('{armed}')")
            screen.shows("#cause", "start by uid 0")
            screen.begins("#live", "● live, ")
            screen.hides("#fault")
        else:
            screen.reads("#permit", "not armed")
            screen.shows("#fault", "Fault: drive does not follow: LElbowRoll")
            screen.hides("#cause")  # said once
            screen.shows("#fault", "Not seen to stand: LElbowRoll.")
            screen.counts(".state[data-kind=bad]", 1)
        for button in ("#stop", "#disarm"):
            box = screen.page.locator(button).bounding_box()
            assert 0 <= box["x"] <= box["x"] + box["width"] <= size[0]
            assert 0 <= box["y"] <= box["y"] + box["height"] <= size[1]
            assert box["height"] >= 44
        screen.picture(f"{state}_{name}")
        if name == "wall":  # and all of it, or a wall is half empty
            ends = "document.querySelector('#joints').getBoundingClientRect().bottom"
            assert 0.85 * size[1] < screen.page.evaluate(ends) <= size[1]
            assert screen.page.locator(".curve").first.bounding_box()["height"] > 0.2 * size[1]
        screen.page.close()


def test_a_yielding_arm_shows_the_time_that_is_left(phone: Screen, arm: FakeDaemon) -> None:
    arm.changes = {**ARMED, "mode": Mode.ADMITTANCE, "quiet_s": 1.1}
    phone.shows("#permit", "continues in 0.9 s if untouched")


@pytest.mark.skipif(not AXE.exists(), reason="NOT TRIED: page/node_modules is not there (make web)")
@pytest.mark.parametrize("changes", [ARMED, FAULTED], ids=["armed", "fault"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(
    screens: Screens, arm: FakeDaemon, page: Page, changes: dict[str, Any], scheme: str
) -> None:
    arm.changes = changes
    screen = screens.live(f"{page.url}?scene=off", DESKTOP, scheme)
    screen.until("document.querySelector('#checks li')")
    assert screen.faults_of_access() == []


def test_all_can_be_reached_by_keyboard_and_stop_comes_first(screen: Screen) -> None:
    screen.until("document.querySelector('#checks summary')")
    name = "(e => e.id || e.name || e.localName)(document.activeElement)"
    found = []
    for _ in range(8):
        screen.page.keyboard.press("Tab")
        found.append(screen.page.evaluate(name))
    assert found == ["stop", "disarm", "summary", "mode", "contact", "fault", "text", "events"]


def test_markup_from_an_arm_stays_text(screen: Screen, arm: FakeDaemon) -> None:
    text = "<img src=x onerror=alert(1)><b>fault</b>"
    arm.changes = {**FAULTED, "cause": text}
    screen.shows("#fault-cause", text)
    screen.counts("img", 0)


def test_several_arms_are_tabs(screens: Screens, arm: FakeDaemon, tmp_path: Path) -> None:
    arm.changes = ARMED
    with page_of(arm.path, tmp_path / "other.sock") as both:
        screen = screens.live(f"{both.url}?scene=off")
        screen.counts("#tabs a", 2)
        screen.shows("#tabs", "tracking, armed")
        screen.shows("#tabs", "no connection")
        screen.picture("tabs")
        screen.page.click("#tabs a:nth-child(2)")
        screen.shows("#connection", "other-view.sock")
        screen.reads("#mode", "no connection")
        screen.picture("gone")


def test_tabs_show_no_connection_once_their_server_is_lost(
    screens: Screens, arm: FakeDaemon, tmp_path: Path
) -> None:
    arm.changes = ARMED
    with page_of(arm.path, tmp_path / "other.sock") as both:
        screen = screens.open(f"{both.url}?scene=off")
        screen.shows("#tabs", "tracking, armed")
        both.process.send_signal(signal.SIGSTOP)
        try:
            screen.until("!document.querySelector('#tabs').innerText.includes('tracking')")
            gone = "document.querySelector('#tabs').innerText.split('no connection').length === 3"
            screen.until(gone)
        finally:
            both.process.send_signal(signal.SIGCONT)
        screen.shows("#tabs", "tracking, armed")


def test_read_only_has_no_buttons(screens: Screens, arm: FakeDaemon) -> None:
    with page_of(arm.path, options=("--read-only", "--no-recordings")) as shown:
        screen = screens.live(f"{shown.url}?scene=off")
        screen.hides("#stop")
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
        screen.reads("[role=alert]", "That is not the token.")
        screen.picture("token")
        screen.errors.clear()  # the browser reports the 401
        screen.page.fill("input", "0123456789abcdef")
        screen.page.click("button")
        screen.live()
        screen.page.reload()
        screen.live()


def test_detected_torques_are_shown_above_all_joints(phone: Screen, arm: FakeDaemon) -> None:
    arm.changes = {"residual": [0.1, 0.0, 0.0, -0.5, 0.0, 0.9, 0.0]}
    phone.reads("#felt", "Detects: ▲ LWristYaw +0.9 Nm, LElbowYaw −0.5 Nm")
    arm.changes = {"residual": [0.1] * 7}
    phone.reads("#felt", "Detects: nothing beyond its level")


def test_a_stream_is_shown_with_its_phase(phone: Screen, arm: FakeDaemon) -> None:
    arm.changes = ARMED | {"stream": replace(STREAM, phase="waiting", target=[0.0] * 7)}
    waits = "Stream waiting: the arm stands until the stream is within 0.05 rad of it"
    phone.begins("#stream", waits)
    phone.picture("stream_phone")
    arm.changes = ARMED | {"stream": None}
    phone.hides("#stream")


def test_the_residual_of_a_joint_that_does_not_sense_is_unknown(
    phone: Screen, arm: FakeDaemon
) -> None:
    """Its residual is constant, and neither its last contact nor none is shown as detected."""
    blind = {"residual": [0.0] * 6 + [0.9], "sensing": [True] * 6 + [False]}
    arm.changes = {**blind, "fresh": [True] * 6 + [False]}
    phone.reads("#felt", "Detects: unknown for LWristPitch")
    phone.counts(".joint.beyond", 0)
    phone.begins("article[aria-label=LWristPitch] .torque", "was +0.90 of ")
    arm.changes = {**blind, "sensing": [False] * 7}
    phone.until("document.querySelector('#felt').innerText.endsWith('no joint is sensing')")


def test_a_guide_is_shown(screen: Screen, arm: FakeDaemon) -> None:
    arm.changes = {"guide": "stiff y z; frame tool"}
    screen.shows("#guide", "Guide for a hand: stiff y z; frame tool")
    arm.changes = {}
    screen.hides("#guide")


def test_events_are_filtered(screen: Screen, arm: FakeDaemon) -> None:
    arm.changes = {"notices": [Notice(kind="contact", text="contact at LShoulderYaw")]}
    screen.until("document.querySelectorAll('#events li[data-kind=contact]').length")
    arm.changes = {}
    screen.page.uncheck("#filter [name=contact]")
    screen.counts("#events li[data-kind]", 0)
    screen.page.check("#filter [name=contact]")
    screen.page.fill("#filter [name=text]", "nothing like it")
    screen.shows("#events", "No event passes")


def test_a_recording_from_the_page(screens: Screens, arm: FakeDaemon, tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    with page_of(arm.path, options=("--recordings", str(folder))) as recording:
        screen = screens.live(f"{recording.url}?scene=off")
        screen.page.click("#record")
        screen.shows("#record", "End")
        screen.page.click("#record")
        screen.counts("#recordings a", 1)
        with screen.page.expect_download() as download:
            screen.page.click("#recordings a")
        assert Path(download.value.path()).read_bytes().startswith(b"\x89MCAP")
        screen.page.click("#recordings button")
        screen.shows("#recordings button", "Really delete?")
        screen.page.wait_for_timeout(2500)  # the list is asked for every two seconds
        screen.shows("#recordings button", "Really delete?")
        screen.page.click("#recordings button")
        screen.counts("#recordings a", 0)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    "shape",
    [
        '<geometry><mesh filename="package://arm/meshes/link.stl"/></geometry>',
        '<geometry><mesh filename="link.obj"/></geometry>',
        "<geometry/>",
        "",
        '<geometry><capsule radius="0.1" length="0.2"/></geometry>',
        '<geometry><box size="0.1 0.1 0.1"/></geometry>',
    ],
)
def test_an_arm_is_drawn_whatever_its_visuals_are(
    screens: Screens, arm: FakeDaemon, shape: str
) -> None:
    text = (ROMEO / "arm.urdf").read_text()
    arm.urdf = text.replace("<inertial>", f"<visual>{shape}</visual><inertial>")
    with page_of(arm.path) as shown:
        screen = screens.live(f"{shown.url}?scene=on", (1000, 800))
        screen.until("document.querySelector('#scene').dataset.arrows !== undefined")
        screen.reads("#scene-note", "")


@pytest.mark.parametrize("size", [(1000, 800), PHONE], ids=["desk", "phone"])
def test_an_upright_arm_is_in_the_picture_in_any_pose(
    screens: Screens, arm: FakeDaemon, size: tuple[int, int]
) -> None:
    """Colours of links and arrows never touch the picture's edge; those of the grid may."""
    names, levels = load_robot(ROMEO).configuration.joint_names, arm.states(0).threshold
    n = len(names)
    axes, bodies, ranges = ["0 0 1", *["0 1 0"] * 6], [Body(1.0, 0.25)] * n, [(-1.5, 1.5)] * n
    arm.urdf = urdf_of(names, axes, bodies, ranges)
    poses = {
        "up": [0.0] * n,
        "flat": [0.0, 1.5, *[0.0] * (n - 2)],
        "behind": [1.5, -1.5, *[0.0] * (n - 2)],
        "front": [-1.0, 1.5, *[0.0] * (n - 2)],
    }
    with page_of(arm.path) as shown:
        screen = screens.open(f"{shown.url}?scene=on", size)
        for name, pose in poses.items():
            arm.changes = {"link_position": pose, "residual": [10.0 * x for x in levels]}
            screen.live()
            screen.data("#scene", "arrows", f"{n}")
            screen.page.wait_for_timeout(1500)
            shot = screen.page.locator("#scene canvas").screenshot(path=PICTURES / f"{name}.png")
            pixels = imread(io.BytesIO(shot))[..., :3]
            coloured = np.ptp(pixels, axis=-1) > 0.1
            edge = np.concatenate([coloured[[0, -1]].ravel(), coloured[:, [0, -1]].ravel()])
            assert coloured.any()
            assert not edge.any(), name


def test_the_force_at_the_tool_is_an_arrow_with_a_cone_of_its_uncertainty(
    screens: Screens, arm: FakeDaemon
) -> None:
    arm.urdf = (ROMEO / "arm.urdf").read_text()
    force = Wrench(
        force=[0.0, 0.0, -18.0], covariance=[9.0, 0.0, 0.0, 9.0, 0.0, 4.0], unseen=[],
        strength=4.0, misfit=0.8,
    )  # fmt: skip
    with page_of(arm.path) as shown:
        screen = screens.open(f"{shown.url}?scene=on", (1000, 800))
        arm.changes = {**ARMED, "wrench": force}
        screen.shows("#felt", "18 N ± 4 at the tool")
        screen.data("#scene", "force", "18 N ± 4")
        screen.page.wait_for_timeout(500)
        screen.picture("force")
        residual = pushed(6, (0.06, 0.01, 0.0), (3.0, 14.0, -9.0)).tolist()
        touched = {"link_position": POSE.tolist(), "residual": residual}
        arm.changes = {**ARMED, **touched, "wrench": replace(force, misfit=3.0)}
        screen.data("#scene", "force", "")
        screen.until("document.querySelector('#scene').dataset.touch.startsWith('l_wrist ± ')")
        screen.shows("#felt", "touched at l_wrist ± ")
        screen.picture("touch")


def test_a_refused_path_is_drawn_where_two_shapes_would_meet(
    screens: Screens, arm: FakeDaemon
) -> None:
    """Red where it would be; gone once a path is taken."""
    arm.urdf = (ROMEO / "arm.urdf").read_text()
    names = load_robot(ROMEO).configuration.joint_names
    hand = {"name": "hand", "joint": names[-1], "start": [0, 0, 0], "end": [0.1, 0, 0]}
    plane = {"point": [0.0, 0.0, -0.4], "normal": [0.0, 0.0, 2.0]}
    box = {"centre": [0.4, 0.0, 0.0], "size": [0.1, 0.1, 0.1], "rpy": [0.0, 0.0, 0.5]}
    arm.walls = {
        "shapes": {"capsules": [hand | {"radius": 0.05}]},
        "surroundings": {"planes": {"table": plane}, "boxes": {"press": box}},
    }
    there = Meeting(pair=["hand", "table"], position=[1.0] * len(names), text="it leads through")
    with page_of(arm.path) as shown:
        screen = screens.open(f"{shown.url}?scene=on", (1000, 800))
        screen.until("document.querySelector('#scene').dataset.arrows !== undefined")
        before = redness(screen)
        screen.page.check("#shapes input")
        arm.changes = {"meeting": there}
        screen.shows("#meeting", "Refused: it leads through")
        screen.data("#scene", "meeting", "hand table")
        assert drawn(screen, lambda red: red > before + 1000)
        screen.picture("refused")
        arm.changes = {}
        screen.hides("#meeting")
        screen.data("#scene", "meeting", "")
        assert drawn(screen, lambda red: red < before + 100)


def drawn(screen: Screen, true: Callable[[int], bool]) -> bool:
    """True once that holds of the picture's redness, which a busy machine draws late."""
    for _ in range(120):
        if true(redness(screen)):
            return True
        screen.page.wait_for_timeout(250)
    return False


def redness(screen: Screen) -> int:
    """Number of the picture's pixels that are red."""
    shot = screen.page.locator("#scene canvas").screenshot()
    red, green, blue = np.moveaxis(imread(io.BytesIO(shot))[..., :3], -1, 0)
    return int(np.count_nonzero(red > 0.2 + np.maximum(green, blue)))
