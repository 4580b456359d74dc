"""Clients of the page's server without permission, too many, too slow, or with invalid requests."""

import asyncio
import contextlib
import gzip
import os
import re
import socket
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from common.errors import ConfigurationError
from programs.web import server
from programs.web.guard import COOKIE
from programs.web.serve import settings_of
from tests.programs.web.page_server import ticks_in
from tests.programs.web.visitor import (
    DEFAULTS,
    TIMEOUT_S,
    TOKEN,
    Visitor,
    messages,
    token_file,
    visited,
)

FakeDaemon = Any  # of tests/fake_daemon.py
Connection = tuple[asyncio.StreamReader, asyncio.StreamWriter]


def entering(visitor: Visitor, data: Any, **headers: str) -> Any:
    """Answer to a form with the token, without following its redirection."""
    own = {"Origin": visitor.origin, **headers}
    url = f"{visitor.origin}/enter"
    return visitor.session.post(url, data=data, headers=own, allow_redirects=False)


async def opened_to(host: str, *requests: bytes) -> list[Connection]:
    """Connections, each with a request that it has sent."""
    opened = []
    for request in requests:
        opened.append(await asyncio.open_connection(*host.split(":")))
        opened[-1][1].write(request.replace(b"HOST", host.encode()))
        await opened[-1][1].drain()
    return opened


async def close_all(opened: list[Connection]) -> None:
    for _, writer in opened:
        writer.close()
    await asyncio.gather(*(w.wait_closed() for _, w in opened), return_exceptions=True)


async def test_the_token_is_asked_for_once(fake_daemon: FakeDaemon, tmp_path: Path) -> None:
    async with visited(fake_daemon, token_file=token_file(tmp_path)) as visitor:
        assert "asks once for its token" in (await visitor.ask("GET", "/"))[1]
        for path in ("/page.js", "/arms/0/urdf", "/recordings"):
            assert (await visitor.ask("GET", path))[0] == 401
        assert (await visitor.command("/arms/0/stop"))[0] == 401
        with pytest.raises(aiohttp.WSServerHandshakeError, match="401"):
            await visitor.live()
        assert (await visitor.ask("GET", "/?token=wrong"))[0] == 401
        async with entering(visitor, {"token": TOKEN}) as answer:
            assert (answer.status, answer.headers["Location"]) == (303, "/")
            cookie = answer.headers["Set-Cookie"]
            assert cookie.startswith(f"{COOKIE}=")
            assert TOKEN not in cookie
            assert {"HttpOnly", "SameSite=Strict"} <= set(cookie.split("; "))
        assert "page.js" in (await visitor.ask("GET", "/"))[1]
        assert (await visitor.command("/arms/0/stop"))[0] == 200
        assert (await visitor.ask("GET", "/?token=" + TOKEN))[0] == 303


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
async def test_invalid_forms_are_refused_and_not_logged(
    fake_daemon: FakeDaemon, tmp_path: Path, caplog: Any, body: bytes, headers: Any, status: int
) -> None:
    async with visited(fake_daemon, token_file=token_file(tmp_path)) as visitor:
        caplog.clear()
        async with entering(visitor, body, **headers) as answer:
            assert answer.status == status
        assert caplog.messages == []  # nor does a stranger fill the log


async def test_tokens_cannot_be_guessed_in_a_row(fake_daemon: FakeDaemon, tmp_path: Path) -> None:
    async with visited(fake_daemon, token_file=token_file(tmp_path)) as visitor:
        found = [(await visitor.ask("GET", f"/?token=guess{i}"))[0] for i in range(8)]
        assert found == [401] * 5 + [429] * 3
        assert (await visitor.ask("GET", f"/?token={TOKEN}"))[0] == 429


async def test_the_pages_of_an_address_are_bounded(fake_daemon: FakeDaemon) -> None:
    async with visited(fake_daemon) as visitor:
        pages = [await visitor.live() for _ in range(server.MOST_BROWSERS_OF_ONE)]
        with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
            await visitor.live()
        await pages[0].close()
        await visitor.until(lambda: len(visitor.site.arms[0].audience) == len(pages) - 1)
        await visitor.live()


async def test_a_browser_that_does_not_read_costs_others_no_frame(fake_daemon: FakeDaemon) -> None:
    async with visited(fake_daemon) as visitor:
        await visitor.until(lambda: visitor.site.arms[0].snapshot)
        # It reads nothing: a bare connection, with little room.
        idle = socket.create_connection(("127.0.0.1", int(visitor.origin.rsplit(":", 1)[1])))
        idle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        request = (
            f"GET /live/0 HTTP/1.1\r\nHost: {visitor.origin[7:]}\r\n"
            f"Origin: {visitor.origin}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
        )
        idle.sendall(request.encode())
        live = await visitor.live()
        await messages(live, {"hello"})
        arm = visitor.site.arms[0]
        await visitor.until(lambda: len(arm.audience) == 2)
        first = arm.states
        ticks: list[int] = []
        async with asyncio.timeout(TIMEOUT_S):
            while arm.states < first + 300:
                message = await live.receive()
                if message.type is aiohttp.WSMsgType.BINARY and not message.data[5]:
                    ticks += ticks_in(message.data)
        assert ticks == sorted(set(ticks))
        assert ticks[-1] - ticks[0] + 1 - len(ticks) <= arm.lost
        idle.close()


async def test_a_browser_that_sends_on_its_stream_is_disconnected(fake_daemon: FakeDaemon) -> None:
    async with visited(fake_daemon) as visitor:
        for words in ("hello", "x" * 100_000, None):
            live = await visitor.live()
            await (live.ping() if words is None else live.send_str(words))
            async with asyncio.timeout(TIMEOUT_S):
                while not (await live.receive()).type.name.startswith("CLOS"):
                    pass
            await visitor.until(lambda: not len(visitor.site.arms[0].audience))


async def test_the_connections_of_an_address_are_bounded_and_the_oldest_make_room(
    fake_daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("programs.web.serve.MOST_CONNECTIONS_OF_ONE", 4)
    async with visited(fake_daemon) as visitor:
        opened = await opened_to(visitor.origin.removeprefix("http://"), *[b""] * 6)
        closed = [asyncio.create_task(reader.read()) for reader, _ in opened]
        async with asyncio.timeout(TIMEOUT_S):
            assert [await end for end in closed[:2]] == [b"", b""]
        assert not any(end.done() for end in closed[2:])
        await close_all(opened)
        await asyncio.gather(*closed)


async def test_half_requests_neither_block_a_stop_nor_end_a_stream(
    fake_daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("programs.web.serve.MOST_CONNECTIONS_OF_ONE", 6)
    async with visited(fake_daemon) as visitor:
        live = await visitor.live()
        opened = await opened_to(visitor.origin.removeprefix("http://"), *[*RUDE.values()] * 4)
        for _ in range(3):
            assert (await visitor.command("/arms/0/stop"))[0] == 200
        await messages(live, {"hello"})
        await close_all(opened)
    assert [command for command, _ in fake_daemon.seen].count("stop") == 3


RUDE = {
    "nothing": b"",
    "blank lines": b"\r\n\r\n",
    "half a head": b"GET / HTTP/1.1\r\nHost: ",
    "half a body": b"POST /enter HTTP/1.1\r\nHost: HOST\r\nOrigin: http://HOST\r\n"
    b"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 99\r\n\r\ntoken=",
    "an end that never comes": b"POST /arms/0/disarm HTTP/1.1\r\nHost: HOST\r\n"
    b"Transfer-Encoding: chunked\r\n\r\n5\r\n",
}


async def test_a_client_that_takes_too_long_to_ask_is_disconnected(
    fake_daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("programs.web.connections.HEAD_S", 0.3)
    monkeypatch.setattr("programs.web.connections.REQUEST_S", 0.3)
    async with visited(fake_daemon) as visitor:
        async with asyncio.timeout(TIMEOUT_S):
            live = None
            while live is None:  # on a busy machine it may take too long itself
                with contextlib.suppress(aiohttp.ClientError):
                    live = await visitor.live()
            opened = await opened_to(visitor.origin.removeprefix("http://"), *RUDE.values())
            for reader, _ in opened:
                with contextlib.suppress(ConnectionError):
                    await reader.read()
            await close_all(opened)
        # A stream has no end but its own.
        await messages(live, {"hello"})
        assert len(visitor.site.arms[0].audience) == 1


async def test_no_connection_is_used_twice(fake_daemon: FakeDaemon) -> None:
    """A browser would send a stop into one that was lost, when a phone changes its network."""
    async with visited(fake_daemon) as visitor:
        for path in ("/", "/clock", "/nothing", "/page.js"):
            async with visitor.session.get(f"{visitor.origin}{path}") as answer:
                assert answer.headers["Connection"] == "close"


SETTINGS = DEFAULTS | {"view_sockets": [Path("x")], "bind": "127.0.0.1", "port": 8420}


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"bind": "0.0.0.0"}, "--host is required"),
        ({"bind": "0.0.0.0", "hosts": ("arm.local",)}, "use --token-file or --read-only"),
        ({"bind": "10.0.0.7"}, "use --token-file or --read-only"),
        ({"bind": "unix:/tmp/page.sock"}, "--host is required"),
        ({"tls": True}, "--bind unix:PATH"),
        ({"hosts": ("arm.local/page",)}, "--host arm.local/page: must be a name or an address"),
        ({"hosts": ("https://arm.local",)}, "a name or an address"),
        ({"hosts": ("fe80::1",)}, "in brackets"),
        ({"hosts": ("",)}, "a name or an address"),
        ({"view_sockets": [Path("x"), Path("y"), Path("x")]}, "x: given twice"),
    ],
)
def test_settings_that_are_open_to_others_or_invalid_are_refused(
    options: dict[str, Any], text: str
) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(text)):
        settings_of(**SETTINGS | options)


@pytest.mark.parametrize(
    ("content", "mode", "text"),
    [
        ("short", 0o640, "at least 16"),
        ("with spaces in between", 0o640, "at least 16"),
        (TOKEN, 0o644, "is readable for all users"),
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
        settings_of(**SETTINGS | {"token_file": path})
