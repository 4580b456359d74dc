"""Clients of a daemon while it reads its files anew: each goes on by itself, and shows what is
new. In lockstep; the files give the only joint another name."""

import asyncio
import contextlib
import json
import os
import pty
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest
import zenoh
from click.testing import CliRunner
from rosbags.typesys import Stores, get_typestore

from bench.rigs.served_daemon import ServedDaemon, served_daemon
from contactd_client.paths import view_socket_path
from programs.clients.client import Client
from programs.contactd import contactd
from programs.foxglove.server import serve
from tests.programs.web.visitor import visiting
from tests.programs.zenoh.bridge import Bridge
from tests.programs.zenoh.zenoh_router import free_port, session_at

ROOT = Path(contactd.__file__).parents[2]
OLD, NEW = "joint", "elbow"
TIMEOUT_S = 120.0


def rename(arm: Path) -> None:
    """Give the joint its new name in every file."""
    (arm / "identified.yaml").unlink()
    for name, before, after in (
        ("config.yaml", f"- name: {OLD}", f"- name: {NEW}"),
        ("config.yaml", f"    {OLD}: {{amplitude", f"    {NEW}: {{amplitude"),
        ("arm.urdf", f'joint name="{OLD}"', f'joint name="{NEW}"'),
    ):
        text = (arm / name).read_text()
        assert text.count(before) == 1
        (arm / name).write_text(text.replace(before, after))


def tick_until(served: ServedDaemon, what: Callable[[], object]) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not what():
        assert time.monotonic() < deadline, "it never came"
        served.tick()
        time.sleep(served.idle_s)


def take_up(served: ServedDaemon, arm: Path) -> None:
    rename(arm)
    result = served.contactctl("reload")
    assert result.exit_code == 0, result.output
    assert served.service.process.robot.configuration.joint_names == [NEW]


@contextlib.contextmanager
def beside(work: Callable[[], None]) -> Iterator[threading.Thread]:
    """A listener in a thread, which ends by itself."""
    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield thread
    finally:
        thread.join(TIMEOUT_S)
        assert not thread.is_alive()


def test_the_page(served: ServedDaemon, arm: Path) -> None:
    """One browser, one connection: a new beginning, another arm to draw, and what is done of it."""
    shown: list[list[str]] = []
    drawn: list[str] = []
    advised: list[int] = []

    async def visit() -> None:
        async with visiting(view_socket_path(served.path)) as visitor:
            live = await visitor.live()
            while not (drawn and advised):
                message = await live.receive(TIMEOUT_S)
                if message.type is not aiohttp.WSMsgType.TEXT:
                    continue
                reported = json.loads(message.data)
                if reported["kind"] == "hello":
                    shown.append(reported["joints"])
                if reported["kind"] == "hello" and reported["joints"] == [NEW]:
                    drawn.append((await visitor.ask("GET", "/arms/0/urdf"))[1])
                if reported["kind"] == "advice" and drawn:
                    advised.append(len(reported["checks"]))

    with beside(lambda: asyncio.run(visit())) as browser:
        tick_until(served, lambda: [OLD] in shown)
        take_up(served, arm)
        tick_until(served, lambda: not browser.is_alive())
    assert shown[-1] == [NEW]
    assert f'joint name="{NEW}"' in drawn[0]


def test_foxglove(served: ServedDaemon, arm: Path) -> None:
    """The door serves on at the same port; a viewer that comes back finds the new joint."""
    port, ended = free_port(), threading.Event()
    said: list[str] = []
    seen: list[set[str]] = []

    async def view() -> None:
        async with aiohttp.ClientSession() as session:
            while not seen or f"/joints/{NEW}" not in seen[-1]:
                with contextlib.suppress(aiohttp.ClientError):
                    url, topics = f"http://127.0.0.1:{port}", set[str]()
                    seen.append(topics)
                    async with session.ws_connect(url, protocols=["foxglove.sdk.v1"]) as viewer:
                        async for message in viewer:
                            if message.type is aiohttp.WSMsgType.TEXT:
                                reported = json.loads(message.data)
                                topics |= {c["topic"] for c in reported.get("channels", ())}
                            if f"/joints/{NEW}" in topics:
                                return
                await asyncio.sleep(0.05)

    def door() -> None:
        serve(lambda: Client(served.path, TIMEOUT_S), "127.0.0.1", port, 33.0, said.append,
              lambda: not ended.is_set())  # fmt: skip

    pytest.importorskip("foxglove")
    with beside(door), beside(lambda: asyncio.run(view())) as viewer:
        tick_until(served, lambda: any(f"/joints/{OLD}" in topics for topics in seen))
        take_up(served, arm)
        tick_until(served, lambda: not viewer.is_alive())
        ended.set()
        served.run(0.2)
    assert f"/joints/{OLD}" not in seen[-1]
    assert said.count(f"ws://127.0.0.1:{port}: 1 joints") == 2


def test_ros_bridge_and_fleet(served: ServedDaemon, arm: Path) -> None:
    """The same node all the time; the description comes anew, and the fleet sees one arm, alive."""
    store, described, named = get_typestore(Stores.ROS2_JAZZY), list[str](), list[list[str]]()

    def read(sample: Any, kind: str) -> Any:
        return store.deserialize_cdr(sample.payload.to_bytes(), kind)

    def description(sample: zenoh.Sample) -> None:
        described.append(read(sample, "std_msgs/msg/String").data)

    def joint_states(sample: zenoh.Sample) -> None:
        named.append(read(sample, "sensor_msgs/msg/JointState").name)

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        contextlib.closing(session_at(endpoint, "router")),
        contextlib.closing(session_at(endpoint, "client")) as other,
    ):
        other.declare_subscriber("0/left_arm/robot_description/**", description)
        other.declare_subscriber("0/left_arm/joint_states/**", joint_states)
        bridge = Bridge(served.path, endpoint)
        try:
            tick_until(served, lambda: described and [OLD] in named)
            take_up(served, arm)
            tick_until(served, lambda: [NEW] in named)
            asked = ["fleet", "--json", "--connect", endpoint]
            result = served.until(lambda: CliRunner().invoke(contactd.main, asked))
        finally:
            served.until(bridge.close)
    assert [
        f'joint name="{name}"' in text for name, text in zip((OLD, NEW), described, strict=True)
    ]
    (one,) = json.loads(result.stdout)
    assert (one["arm"], one["alive"], one["mode"]) == ("left_arm", True, "off")


def test_watch_goes_on_and_ends_with_the_daemon(arm: Path) -> None:
    ours, theirs = pty.openpty()
    drawn = bytearray()

    def read() -> None:
        with contextlib.suppress(OSError):  # the other end is closed
            while piece := os.read(ours, 1 << 16):
                drawn.extend(piece)

    with served_daemon(arm.parent, arm) as served:
        program = "from programs.contactctl.contactctl import main; main()"
        command = [sys.executable, "-c", program, "--socket", str(served.path), "watch"]
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
        process = subprocess.Popen(
            command, cwd=ROOT, stdin=theirs, stdout=theirs, stderr=theirs, env=environment
        )
        os.close(theirs)
        with beside(read):
            try:
                tick_until(served, lambda: OLD.encode() in drawn)
                take_up(served, arm)
                tick_until(served, lambda: NEW.encode() in drawn)
                served.service.control.close()
                assert process.wait(TIMEOUT_S) == 69
            finally:
                process.kill()
                process.wait()
        os.close(ours)
    assert b"the daemon hung up" in drawn
    assert b"Traceback" not in drawn
