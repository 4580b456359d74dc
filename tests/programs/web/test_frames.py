"""Binary frames: what Python packs, the page's own JavaScript reads, where there is node."""

import json
import math
import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from msgspec.structs import replace

from daemon.protocol.state import Contact, Notice, Permit, State
from programs.web import frames
from tests.fake_daemon import state_at

ROOT = Path(__file__).resolve().parents[3]
READ = """
import { framesOf } from "./page/src/frames.js";
import { readFileSync } from "node:fs";
const bytes = readFileSync(0);
const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
const plain = (key, value) => (typeof value === "number" && !Number.isFinite(value) ? null : value);
console.log(JSON.stringify([...framesOf(buffer)], plain));
"""

JOINTS = ["one", "two", "three"]


@pytest.fixture
def states() -> list[State]:
    """Three ticks, of which the second collides and the third is armed."""
    collision = Contact(joint="two", torque=-9.0, threshold=4.0, level="collision", side="left")
    first = replace(
        state_at(41),
        fresh=[True, True, False],
        side=["left", "gap", "unknown"],
        sensing=[True, False, True],
        touched_link="",
        residual=[0.5, -1.25, 3.0],
        threshold=[1.0, 2.0, 3.0],
        phi=[0.001, 0.002, -0.003],
        phi_sigma=[0.0005, 0.001, 0.002],
        link_position=[0.1, -0.2, 0.3],
    )
    permit = Permit(uid=0, pid=7, detached=False, left_s=12.5)
    return [
        first,
        replace(
            first,
            tick=42,
            time_s=first.time_s + 0.01,
            touched_link="two",
            unproved=["three"],
            notices=[Notice(kind="contact", text="two", contact=collision)],
        ),
        replace(first, tick=44, time_s=first.time_s + 0.03, armed=True, moving=True, permit=permit),
    ]


def read(data: bytes) -> list[dict[str, object]]:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node here: the page's reader of frames is not tried")
    done = subprocess.run(
        [node, "--input-type=module", "-e", READ],
        input=data,
        capture_output=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()
    found: list[dict[str, object]] = json.loads(done.stdout)
    return found


def with_length(frame: bytes) -> bytes:
    return struct.pack("<I", len(frame)) + frame


def test_the_page_reads_what_is_packed(states: list[State]) -> None:
    live = frames.encode(states, JOINTS)
    past, now = read(with_length(frames.as_past(live)) + with_length(live))
    assert (past["past"], now["past"]) == (True, False)
    assert past["ticks"] == now["ticks"]
    last = states[-1]
    assert now["left_s"] == 12.5
    assert (now["missed"], now["wall_s"]) == (last.timing.missed, last.timing.wall_s)
    assert now["monotonic_s"] == last.timing.monotonic_s
    for found, state in zip(now["ticks"], states, strict=True):  # type: ignore[call-overload]
        assert found["tick"] == state.tick
        assert found["time_s"] == pytest.approx(state.time_s, abs=1e-6)
        assert frames.MODES[found["mode"]] == state.mode
        assert (found["armed"], found["moving"]) == (state.armed, state.moving)
        for name in frames.VECTORS:
            assert found[name] == pytest.approx(getattr(state, name), rel=1e-6)
        assert [joint["side"] for joint in found["joints"]] == state.side
        assert [joint["sensing"] for joint in found["joints"]] == state.sensing
        assert [joint["fresh"] for joint in found["joints"]] == state.fresh
    flags = [[j["collision"] for j in found["joints"]] for found in now["ticks"]]  # type: ignore[attr-defined]
    assert flags == [[False] * 3, [False, True, False], [False] * 3]
    second = now["ticks"][1]["joints"]  # type: ignore[index]
    assert [joint["touched"] for joint in second] == [False, True, False]
    assert [joint["unproved"] for joint in second] == [False, False, True]


def test_not_armed_has_no_time_left(states: list[State]) -> None:
    *_, left_s = frames.HEADER.unpack_from(frames.encode(states[:1], JOINTS))
    assert math.isnan(left_s)


def test_a_state_of_an_older_format_is_taken_as_sensing(states: list[State]) -> None:
    old = replace(states[0], sensing=None)
    flags = frames.encode([old], JOINTS)[frames.HEADER.size + frames.TICK.size :][:3]
    assert all(flag & frames.SENSING for flag in flags)


@pytest.mark.parametrize("joints", range(1, 9))
def test_sizes_stay_in_step(states: list[State], joints: int) -> None:
    def some(values: list[object]) -> list[object]:
        return (values * 8)[:joints]

    names = [f"joint {i}" for i in range(joints)]
    fields = {name: some(getattr(states[0], name)) for name in ("fresh", "side", "sensing")}
    vectors = {name: some(getattr(states[0], name)) for name in frames.VECTORS}
    state = replace(states[0], **fields, **vectors)
    (found,) = read(with_length(frames.encode([state, state], names)))
    assert [len(tick["residual"]) for tick in found["ticks"]] == [joints] * 2  # type: ignore[attr-defined]
    assert found["ticks"][1]["link_position"] == pytest.approx(state.link_position, rel=1e-6)  # type: ignore[index]
