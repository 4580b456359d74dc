"""The page's server: what it serves, to whom, and what it does when daemon or browser is gone."""

import asyncio
import contextlib
import gzip
import json
import os
import socket
import struct
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from bench.rigs.page import ticks_in
from daemon.protocol.doors import view_socket_path
from daemon.web import frames, server
from daemon.web.guard import COMMAND_HEADER, COOKIE, HEADERS
from daemon.web.serve import listen, serving, settings_of
from daemon.web.server import Site
from errors import ConfigurationError

FakeDaemon = Any  # of tests/daemon/conftest.py, which nothing imports
TOKEN = "0123456789abcdef0123"
PATIENCE_S = 20.0


class Visitor:
    """A browser's requests, of the page's own scripts unless said otherwise."""

    def __init__(self, session: aiohttp.ClientSession, site: Site, port: int) -> None:
        self.session, self.site = session, site
        self.origin = f"http://127.0.0.1:{port}"
        self._lives: list[aiohttp.ClientWebSocketResponse] = []

    async def ask(self, method: str, path: str, **headers: str) -> tuple[int, str]:
        url, own = f"{self.origin}{path}", {"Origin": self.origin}
        async with self.session.request(
            method, url, headers={**own, **headers}, allow_redirects=False
        ) as answer:
            assert {name: answer.headers.get(name) for name in HEADERS} == HEADERS
            return answer.status, await answer.text()

    async def command(self, path: str) -> tuple[int, Any]:
        name = path.rsplit("/", 1)[-1]
        status, text = await self.ask("POST", path, **{COMMAND_HEADER: name})
        return status, json.loads(text) if status == 200 else text

    async def live(self, **headers: str) -> aiohttp.ClientWebSocketResponse:
        url, own = f"{self.origin}/live/0", {"Origin": self.origin}
        self._lives.append(await self.session.ws_connect(url, headers={**own, **headers}))
        return self._lives[-1]

    async def leave(self) -> None:
        for live in self._lives:
            await live.close()

    async def until(self, what: Callable[[], object]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not what():
                await asyncio.sleep(0.01)


@asynccontextmanager
async def visiting(*view_sockets: Path, **options: Any) -> AsyncIterator[Visitor]:
    defaults: dict[str, Any] = {
        "hosts": (),
        "tls": False,
        "read_only": False,
        "token_file": None,
        "recordings": None,
    }
    with listen("127.0.0.1", 0) as listener:
        port = listener.getsockname()[1]
        settings = settings_of(view_sockets, bind="127.0.0.1", port=port, **{**defaults, **options})
        jar = aiohttp.CookieJar(unsafe=True)
        async with (
            serving(settings, listener) as site,
            aiohttp.ClientSession(cookie_jar=jar) as session,
        ):
            visitor = Visitor(session, site, port)
            yield visitor
            await visitor.leave()


async def messages(
    live: aiohttp.ClientWebSocketResponse, kinds: set[str]
) -> tuple[dict[str, dict[str, Any]], bytes]:
    """The first text of each kind, and the first binary message that is live."""
    texts: dict[str, dict[str, Any]] = {}
    frame = b""
    async with asyncio.timeout(PATIENCE_S):
        while not (frame and kinds <= set(texts)):
            message = await live.receive()
            if message.type is aiohttp.WSMsgType.TEXT:
                found = json.loads(message.data)
                texts.setdefault(found["kind"], found)
            elif message.type is aiohttp.WSMsgType.BINARY and not message.data[5]:
                frame = message.data
    return texts, frame


def door(daemon: FakeDaemon) -> Path:
    return view_socket_path(daemon.path)


def test_a_browser_gets_files_words_and_frames(fake_daemon: FakeDaemon) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
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
            assert texts["words"]["mode"] == texts["summary"]["modes"][0]
            assert [check["passed"] for check in texts["advice"]["checks"]] == [False, True, False]
            (length,) = struct.unpack_from("<I", frame)
            assert length == len(frame) - 4
            assert frame[4] == frames.VERSION
            await live.close()

    asyncio.run(visit())


@pytest.mark.parametrize("command", ["stop", "disarm"])
def test_a_command_reaches_the_daemon_and_says_what_became_of_it(
    fake_daemon: FakeDaemon, command: str
) -> None:
    fake_daemon.mode = "stopping"
    fake_daemon.modes = {command: ["stopping", "holding"]}

    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
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

    asyncio.run(visit())


def test_a_joint_that_is_not_seen_to_stand_is_said(fake_daemon: FakeDaemon) -> None:
    fake_daemon.mode, fake_daemon.unproved = "faulted", ["LElbowYaw"]

    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            _, found = await visitor.command("/arms/0/stop")
            assert (found["outcome"], found["text"]) == ("not seen to stand", "LElbowYaw")

    asyncio.run(visit())


def test_a_refusal_is_said(fake_daemon: FakeDaemon) -> None:
    fake_daemon.refusals = {"stop": ["it is a test"]}

    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            _, found = await visitor.command("/arms/0/stop")
            assert (found["outcome"], "it is a test" in found["text"]) == ("refused", True)

    asyncio.run(visit())


def test_no_daemon_is_not_reached(tmp_path: Path) -> None:
    async def visit() -> None:
        async with visiting(tmp_path / "nobody-view.sock") as visitor:
            status, found = await visitor.command("/arms/0/stop")
            assert (status, found["outcome"]) == (200, "not reached")
            live = await visitor.live()
            kinds = [json.loads((await live.receive()).data)["kind"] for _ in range(3)]
            assert kinds == ["hello", "events", "gone"]
            await live.close()

    asyncio.run(visit())


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


def test_read_only_commands_nothing(fake_daemon: FakeDaemon, tmp_path: Path) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon), read_only=True, recordings=tmp_path) as visitor:
            for path in ("/arms/0/stop", "/arms/0/disarm", "/arms/0/record", "/recordings/end"):
                status, text = await visitor.command(path)
                assert status == 403
                assert "only shows" in text
            texts, _ = await messages(await visitor.live(), {"hello"})
            assert not texts["hello"]["may_command"]
            assert {name for name, _ in fake_daemon.seen} <= {"status", "subscribe"}

    asyncio.run(visit())


def token_file(folder: Path) -> Path:
    path = folder / "token"
    path.write_text(TOKEN + "\n")
    path.chmod(0o640)
    return path


def test_the_token_is_asked_for_once(fake_daemon: FakeDaemon, tmp_path: Path) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon), token_file=token_file(tmp_path)) as visitor:
            assert "asks once for its token" in (await visitor.ask("GET", "/"))[1]
            for path in ("/page.js", "/arms/0/urdf", "/recordings"):
                assert (await visitor.ask("GET", path))[0] == 401
            assert (await visitor.command("/arms/0/stop"))[0] == 401
            with pytest.raises(aiohttp.WSServerHandshakeError, match="401"):
                await visitor.live()
            assert (await visitor.ask("GET", "/?token=wrong"))[0] == 401
            url = f"{visitor.origin}/enter"
            form = {"token": TOKEN}
            async with visitor.session.post(
                url, data=form, headers={"Origin": visitor.origin}, allow_redirects=False
            ) as answer:
                assert (answer.status, answer.headers["Location"]) == (303, "/")
                cookie = answer.headers["Set-Cookie"]
                assert cookie.startswith(f"{COOKIE}=")
                assert TOKEN not in cookie
                assert "HttpOnly" in cookie
                assert "SameSite=Strict" in cookie
            assert "page.js" in (await visitor.ask("GET", "/"))[1]
            assert (await visitor.command("/arms/0/stop"))[0] == 200
            assert (await visitor.ask("GET", "/?token=" + TOKEN))[0] == 303

    asyncio.run(visit())


FORM = "application/x-www-form-urlencoded"


@pytest.mark.parametrize(
    ("body", "headers", "status"),
    [
        (b"token=%s" % TOKEN.encode(), {"Content-Type": FORM}, 303),
        (b"", {"Content-Type": FORM}, 401),
        (b"&&=;token", {"Content-Type": FORM}, 401),
        (b"token=\xff\xfe\xed\xa0\x80", {"Content-Type": FORM}, 401),
        (b"token=%ff%00", {"Content-Type": f"{FORM}; charset=no-such"}, 401),
        (b"hello", {"Content-Type": "multipart/form-data"}, 401),
        (b"hello", {"Content-Type": FORM, "Content-Encoding": "gzip"}, 401),
        (gzip.compress(b"token=" + bytes(4_000_000)), {"Content-Encoding": "gzip"}, 401),
        (b"token=" + b"x" * 5000, {"Content-Type": FORM}, 413),
    ],
)
def test_no_form_upsets_it(
    fake_daemon: FakeDaemon,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    body: bytes,
    headers: dict[str, str],
    status: int,
) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon), token_file=token_file(tmp_path)) as visitor:
            caplog.clear()
            own = {"Origin": visitor.origin, **headers}
            async with visitor.session.post(
                f"{visitor.origin}/enter", data=body, headers=own, allow_redirects=False
            ) as answer:
                assert answer.status == status
            assert caplog.messages == []  # nor does a stranger fill the log

    asyncio.run(visit())


def test_tokens_cannot_be_guessed_in_a_row(fake_daemon: FakeDaemon, tmp_path: Path) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon), token_file=token_file(tmp_path)) as visitor:
            found = [(await visitor.ask("GET", f"/?token=guess{i}"))[0] for i in range(8)]
            assert found == [401] * 5 + [429] * 3
            assert (await visitor.ask("GET", f"/?token={TOKEN}"))[0] == 429

    asyncio.run(visit())


def test_an_address_has_so_many_pages_and_no_more(fake_daemon: FakeDaemon) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            pages = [await visitor.live() for _ in range(server.MOST_BROWSERS_OF_ONE)]
            with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
                await visitor.live()
            await pages[0].close()
            await visitor.until(lambda: len(visitor.site.arms[0].audience) == len(pages) - 1)
            await visitor.live()

    asyncio.run(visit())


def test_a_browser_that_does_not_read_costs_nobody_a_frame(fake_daemon: FakeDaemon) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            await visitor.until(lambda: visitor.site.arms[0].snapshot)
            # It reads nothing: a bare connection, with little room.
            deaf = socket.create_connection(("127.0.0.1", int(visitor.origin.rsplit(":", 1)[1])))
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            request = (
                f"GET /live/0 HTTP/1.1\r\nHost: {visitor.origin[7:]}\r\n"
                f"Origin: {visitor.origin}\r\n"
                "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
            )
            deaf.sendall(request.encode())
            live = await visitor.live()
            await messages(live, {"hello"})
            arm = visitor.site.arms[0]
            await visitor.until(lambda: len(arm.audience) == 2)
            first = arm.states
            ticks: list[int] = []
            async with asyncio.timeout(PATIENCE_S):
                while arm.states < first + 300:
                    message = await live.receive()
                    if message.type is aiohttp.WSMsgType.BINARY and not message.data[5]:
                        ticks += ticks_in(message.data)
            assert ticks == sorted(set(ticks))
            assert ticks[-1] - ticks[0] + 1 - len(ticks) <= arm.lost
            deaf.close()

    asyncio.run(visit())


def test_a_browser_that_talks_is_hung_up_on(fake_daemon: FakeDaemon) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            for words in ("hello", "x" * 100_000, None):
                live = await visitor.live()
                await (live.ping() if words is None else live.send_str(words))
                async with asyncio.timeout(PATIENCE_S):
                    while not (await live.receive()).type.name.startswith("CLOS"):
                        pass
                await visitor.until(lambda: not len(visitor.site.arms[0].audience))

    asyncio.run(visit())


def test_an_address_has_so_many_connections(
    fake_daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.web.serve.MOST_CONNECTIONS_OF_ONE", 4)

    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            port = int(visitor.origin.rsplit(":", 1)[1])
            opened = [await asyncio.open_connection("127.0.0.1", port) for _ in range(6)]
            closed = [asyncio.create_task(reader.read()) for reader, _ in opened]
            async with asyncio.timeout(PATIENCE_S):
                assert [await end for end in closed[4:]] == [b"", b""]
            assert not any(end.done() for end in closed[:4])
            for _, writer in opened:
                writer.close()
            await asyncio.gather(*closed)
            await asyncio.gather(*(w.wait_closed() for _, w in opened), return_exceptions=True)

    asyncio.run(visit())


RUDE = {
    "nothing": b"",
    "blank lines": b"\r\n\r\n",
    "half a head": b"GET / HTTP/1.1\r\nHost: ",
    "half a body": b"POST /enter HTTP/1.1\r\nHost: HOST\r\nOrigin: http://HOST\r\n"
    b"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 99\r\n\r\ntoken=",
    "an end that never comes": b"POST /arms/0/disarm HTTP/1.1\r\nHost: HOST\r\n"
    b"Transfer-Encoding: chunked\r\n\r\n5\r\n",
}


def test_who_takes_too_long_to_ask_is_hung_up_on(
    fake_daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.web.connections.REQUEST_S", 0.3)

    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            host = visitor.origin.removeprefix("http://")
            async with asyncio.timeout(PATIENCE_S):
                live = None
                while live is None:  # on a busy machine it may take too long itself
                    with contextlib.suppress(aiohttp.ClientError):
                        live = await visitor.live()
                opened = []
                for said in RUDE.values():
                    opened.append(await asyncio.open_connection(*host.split(":")))
                    opened[-1][1].write(said.replace(b"HOST", host.encode()))
                for reader, writer in opened:
                    with contextlib.suppress(ConnectionError):
                        await reader.read()
                    writer.close()
                    with contextlib.suppress(ConnectionError):
                        await writer.wait_closed()
            await messages(live, {"hello"})  # a stream has no end but its own
            await live.receive(PATIENCE_S)
            assert not live.closed

    asyncio.run(visit())


def test_no_connection_is_used_twice(fake_daemon: FakeDaemon) -> None:
    """A browser would send a stop into one that was lost, when a phone changes its network."""

    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            for path in ("/", "/clock", "/nothing", "/page.js"):
                async with visitor.session.get(f"{visitor.origin}{path}") as answer:
                    assert answer.headers["Connection"] == "close"

    asyncio.run(visit())


def test_the_clock_is_that_of_the_states(fake_daemon: FakeDaemon) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon)) as visitor:
            before_s = time.monotonic()
            status, text = await visitor.ask("GET", "/clock")
            assert status == 200
            assert before_s <= float(text) <= time.monotonic()

    asyncio.run(visit())


def test_there_are_signs_of_life_while_there_is_no_daemon(tmp_path: Path) -> None:
    async def visit() -> None:
        async with visiting(tmp_path / "nobody-view.sock") as visitor:
            live = await visitor.live()
            kinds: list[str] = []
            async with asyncio.timeout(PATIENCE_S):
                while kinds.count("summary") < 3:
                    kinds.append(json.loads((await live.receive()).data)["kind"])

    asyncio.run(visit())


def test_a_recording_is_made_downloaded_and_deleted(
    fake_daemon: FakeDaemon, tmp_path: Path
) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon), recordings=tmp_path / "made") as visitor:
            await visitor.until(lambda: visitor.site.arms[0].snapshot)
            status, shown = await visitor.command("/arms/0/record")
            name = shown["running"]
            assert (status, name.startswith("Romeo_left_arm-")) == (200, True)
            assert (await visitor.command("/arms/0/record"))[0] == 409
            assert (await visitor.ask("GET", f"/recordings/{name}"))[0] == 404  # not complete yet
            await visitor.until(lambda: visitor.site.recorder.shown().bytes > 10_000)  # type: ignore[union-attr]
            _, shown = await visitor.command("/recordings/end")
            assert [file["name"] for file in shown["files"]] == [name]
            assert "states" in shown["said"]
            async with visitor.session.get(f"{visitor.origin}/recordings/{name}") as answer:
                data = await answer.read()
                assert answer.headers["Content-Disposition"] == f'attachment; filename="{name}"'
            assert data.startswith(b"\x89MCAP")
            assert data.endswith(b"\x89MCAP0\r\n")
            for wrong in ("..%2F..%2Fsecret.mcap", "other.mcap", "%2Fetc%2Fpasswd"):
                assert (await visitor.ask("GET", f"/recordings/{wrong}"))[0] == 404
            _, shown = await visitor.command(f"/recordings/{name}/delete")
            assert shown["files"] == []

    asyncio.run(visit())


@pytest.mark.parametrize(
    ("bound", "value", "why"),
    [
        ("LONGEST_S", 0.1, "minutes, which is the longest"),
        ("DISK_LEFT_BYTES", 1 << 60, "others need the last"),
    ],
)
def test_a_recording_that_came_to_a_bound_says_so(
    fake_daemon: FakeDaemon,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    bound: str,
    value: float,
    why: str,
) -> None:
    async def visit() -> None:
        async with visiting(door(fake_daemon), recordings=tmp_path) as visitor:
            await visitor.until(lambda: visitor.site.arms[0].snapshot)
            assert (await visitor.command("/arms/0/record"))[0] == 200
            monkeypatch.setattr(f"daemon.web.recordings.{bound}", value)
            recorder = visitor.site.recorder
            assert recorder is not None
            await visitor.until(lambda: not recorder.shown().running)
            assert why in recorder.shown().said
            assert "states" in recorder.shown().said  # and the file is complete

    asyncio.run(visit())


def test_a_recording_never_fills_the_disk(
    fake_daemon: FakeDaemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.web.recordings.MOST_BYTES", 200_000)
    monkeypatch.setattr("daemon.web.recordings.ROOM_BYTES", 230_000)

    async def visit() -> None:
        async with visiting(door(fake_daemon), recordings=tmp_path) as visitor:
            await visitor.until(lambda: visitor.site.arms[0].snapshot)
            assert (await visitor.command("/arms/0/record"))[0] == 200
            recorder = visitor.site.recorder
            assert recorder is not None
            await visitor.until(lambda: not recorder.shown().running)
            (file,) = recorder.shown().files
            assert 100_000 < file.bytes < 400_000
            assert "which is all the room that it had" in recorder.shown().said
            status, text = await visitor.command("/arms/0/record")
            assert status == 409
            assert "no room" in text

    asyncio.run(visit())


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"bind": "0.0.0.0"}, "say by --host"),
        ({"bind": "0.0.0.0", "hosts": ("arm.local",)}, "give a --token-file, or --read-only"),
        ({"bind": "10.0.0.7"}, "give a --token-file, or --read-only"),
        ({"bind": "unix:/tmp/page.sock"}, "say by --host"),
        ({"tls": True}, "--bind unix:PATH"),
    ],
)
def test_what_would_let_others_in_unasked_is_refused(options: dict[str, Any], text: str) -> None:
    given: dict[str, Any] = {"bind": "127.0.0.1", "hosts": (), "tls": False, **options}
    with pytest.raises(ConfigurationError, match=text):
        settings_of(
            [Path("x")], port=8420, read_only=False, token_file=None, recordings=None, **given
        )


@pytest.mark.parametrize(
    ("content", "mode", "text"),
    [
        ("short", 0o640, "at least 16"),
        ("with spaces in between", 0o640, "at least 16"),
        (TOKEN, 0o644, "everybody may read it"),
        (None, 0, "cannot be read"),
    ],
)
def test_a_bad_token_file_is_refused(
    tmp_path: Path, content: str | None, mode: int, text: str
) -> None:
    path = tmp_path / "token"
    if content is not None:
        path.write_text(content)
        os.chmod(path, mode)
    with pytest.raises(ConfigurationError, match=text):
        settings_of(
            [Path("x")],
            bind="127.0.0.1",
            port=8420,
            hosts=(),
            tls=False,
            read_only=False,
            token_file=path,
            recordings=None,
        )
