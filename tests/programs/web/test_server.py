"""The page's server: what it serves, and what it does when the daemon is gone."""

import asyncio
import contextlib
import json
import socket
import struct
import time
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

from common.errors import UnreachableError
from daemon.modes.table import Mode
from daemon.protocol.replies import Reply
from programs.clients.stopping import carry_out
from programs.web import arm, frames
from programs.web.guard import COMMAND_HEADER
from programs.web.serve import listen
from tests.fake_daemon import state_at
from tests.programs.web.visitor import TIMEOUT_S, Visitor, messages, visited, visiting

FakeDaemon = Any  # of tests/fake_daemon.py


async def test_a_browser_gets_files_words_and_frames(fake_daemon: FakeDaemon) -> None:
    async with visited(fake_daemon) as visitor:
        for path in ("/", "/page.js", "/page.css", "/scene.js", "/icon.svg"):
            assert (await visitor.ask("GET", path))[0] == 200
        for path in ("/../server.py", "/built/", "/live/7", "/arms/7/urdf", "/nothing"):
            assert (await visitor.ask("GET", path))[0] == 404
        await visitor.until(lambda: visitor.site.arms[0].snapshot)
        assert await visitor.ask("GET", "/arms/0/urdf") == (200, "<robot/>")
        live = await visitor.live()
        texts, frame = await messages(live, {"hello", "words", "advice", "summary"})
        assert texts["hello"]["arms"] == ["Romeo left arm"]
        assert texts["hello"]["may_command"]
        assert texts["summary"]["modes"][0] in ("", texts["words"]["mode"])  # of another moment
        assert [check["passed"] for check in texts["advice"]["checks"]] == [False, True, False]
        (length,) = struct.unpack_from("<I", frame)
        assert length == len(frame) - 4
        assert frame[4] == frames.VERSION
        await live.close()


async def test_the_arming_checks_are_asked_for_again_once_a_torque_changes(
    fake_daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the page shows no torque of a joint, and a check that fails by its torque."""
    monkeypatch.setattr(arm, "STATUS_EVERY_S", 3600.0)

    def feel(torque: float) -> None:
        state = state_at(0, cause=f"{torque}", thresholded=[torque] + [0.0] * 6)
        fake_daemon.states = lambda tick: msgspec.structs.replace(state, tick=tick)

    def asked() -> int:
        return [name for name, _ in fake_daemon.seen].count("status")

    def taken(visitor: Visitor, torque: float, before: int) -> bool:
        words = visitor.site.arms[0].words
        return words is not None and words.cause == f"{torque}" and asked() > before

    feel(0.0)
    async with visited(fake_daemon) as visitor:
        await messages(await visitor.live(), {"words", "advice"})
        for torque in [0.3, 0.0] * 3:  # more often than a visitor makes it ask
            before = asked()
            feel(torque)
            await visitor.until(partial(taken, visitor, torque, before))


@pytest.mark.parametrize("command", ["stop", "disarm"])
async def test_a_command_reaches_the_daemon_and_returns_its_outcome(
    fake_daemon: FakeDaemon, command: str
) -> None:
    fake_daemon.mode = "stopping"
    fake_daemon.modes = {command: ["stopping", "holding"]}
    async with visited(fake_daemon) as visitor:
        path = f"/arms/0/{command}"
        # A form of another site, one of our own, a script without the header.
        assert (await visitor.ask("POST", path, Origin="http://evil.example"))[0] == 403
        assert (await visitor.ask("POST", path))[0] == 403
        assert (await visitor.ask("POST", path, **{COMMAND_HEADER: "record"}))[0] == 403
        assert (await visitor.ask("GET", path))[0] == 405
        assert command not in [name for name, _ in fake_daemon.seen]
        status, found = await visitor.command(path)
        assert (status, found["outcome"], found["mode"]) == (200, "stands", "holding")
        assert [name for name, _ in fake_daemon.seen].count(command) == 1


async def test_a_joint_without_confirmed_standstill_is_reported(fake_daemon: FakeDaemon) -> None:
    fake_daemon.mode, fake_daemon.unproved = "faulted", ["LElbowYaw"]
    async with visited(fake_daemon) as visitor:
        _, found = await visitor.command("/arms/0/stop")
        assert (found["outcome"], found["text"]) == ("not seen to stand", "LElbowYaw")


async def test_a_refusal_is_reported(fake_daemon: FakeDaemon) -> None:
    fake_daemon.refusals = {"stop": ["it is a test"]}
    async with visited(fake_daemon) as visitor:
        _, found = await visitor.command("/arms/0/stop")
        assert (found["outcome"], "it is a test" in found["text"]) == ("refused", True)


async def test_no_daemon_is_not_reached(tmp_path: Path) -> None:
    async with visiting(tmp_path / "absent-view.sock") as visitor:
        status, found = await visitor.command("/arms/0/stop")
        assert (status, found["outcome"]) == (200, "not reached")
        live = await visitor.live()
        kinds = [json.loads((await live.receive()).data)["kind"] for _ in range(3)]
        assert kinds == ["hello", "events", "gone"]
        await live.close()


def test_a_daemon_that_hangs_is_not_reached_in_time(tmp_path: Path) -> None:
    path = tmp_path / "hung-view.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as hung:
        hung.bind(str(path))
        hung.listen()

        async def visit() -> None:
            async with visiting(path) as visitor:
                begun = asyncio.get_running_loop().time()
                _, found = await visitor.command("/arms/0/stop")
                assert found["outcome"] == "not reached"
                assert asyncio.get_running_loop().time() - begun >= 0.7

        asyncio.run(visit())


def test_a_full_backlog_of_the_view_socket_only_delays_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("programs.clients.stopping.WITHIN_S", TIMEOUT_S)
    path = tmp_path / "full-view.sock"

    async def visit(full: socket.socket) -> None:
        throng = []
        with contextlib.suppress(BlockingIOError):
            while True:
                throng.append(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
                throng[-1].setblocking(False)
                throng[-1].connect(str(path))
        stopping = asyncio.create_task(carry_out(path, "stop", "a test"))
        await asyncio.sleep(0.1)
        assert not stopping.done()
        reply = Reply(ok=True, message="stop", mode=Mode.HOLDING)
        heard: list[bytes] = []
        inside = []
        async with asyncio.timeout(TIMEOUT_S):
            while not heard:
                with contextlib.suppress(BlockingIOError):
                    inside.append(full.accept()[0])
                    inside[-1].setblocking(False)
                for one in inside:
                    with contextlib.suppress(BlockingIOError):
                        if packet := one.recv(1000):
                            heard.append(packet)
                            one.send(msgspec.json.encode(reply))
                await asyncio.sleep(0)
            assert (await stopping).outcome == "stands"
        for one in (*throng, *inside):
            one.close()

    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as full:
        full.bind(str(path))
        full.listen(0)
        full.setblocking(False)
        asyncio.run(visit(full))


async def test_read_only_commands_nothing(fake_daemon: FakeDaemon, tmp_path: Path) -> None:
    async with visited(fake_daemon, read_only=True, recordings=tmp_path) as visitor:
        for path in ("/arms/0/stop", "/arms/0/disarm", "/arms/0/record", "/recordings/end"):
            status, text = await visitor.command(path)
            assert status == 403
            assert "read-only" in text
        texts, _ = await messages(await visitor.live(), {"hello"})
        assert not texts["hello"]["may_command"]
        assert {name for name, _ in fake_daemon.seen} <= {"status", "subscribe"}


async def test_the_clock_is_that_of_the_states(fake_daemon: FakeDaemon) -> None:
    async with visited(fake_daemon) as visitor:
        before_s = time.monotonic()
        status, text = await visitor.ask("GET", "/clock")
        assert status == 200
        assert before_s <= float(text) <= time.monotonic()


async def test_summaries_are_sent_while_there_is_no_daemon(tmp_path: Path) -> None:
    async with visiting(tmp_path / "absent-view.sock") as visitor:
        live = await visitor.live()
        kinds: list[str] = []
        async with asyncio.timeout(TIMEOUT_S):
            while kinds.count("summary") < 3:
                kinds.append(json.loads((await live.receive()).data)["kind"])


def test_an_unknown_host_name_is_reported() -> None:
    with pytest.raises(UnreachableError, match=r" port 0 \(--bind, --port\): no such address"):
        listen("no address", 0)
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UnreachableError, match=rf"{port} \(--bind, --port\): Address"):
            listen("127.0.0.1", port)
