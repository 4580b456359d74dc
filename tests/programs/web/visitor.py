"""Visitor of the page's server, which runs in the same loop: a browser's requests, for tests."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp

from contactd_client.paths import view_socket_path
from programs.web.elsewhere_routes import Others
from programs.web.guard import COMMAND_HEADER, HEADERS
from programs.web.serve import listen, serving, settings_of
from programs.web.server import Site

TOKEN = "0123456789abcdef0123"
TIMEOUT_S = 20.0
DEFAULTS: dict[str, Any] = {
    "hosts": (),
    "tls": False,
    "read_only": False,
    "token_file": None,
    "recordings": None,
}


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
        async with asyncio.timeout(TIMEOUT_S):
            while not what():
                await asyncio.sleep(0.01)


@asynccontextmanager
async def visiting(
    *view_sockets: Path, others: Others | None = None, **options: Any
) -> AsyncIterator[Visitor]:
    with listen("127.0.0.1", 0) as listener:
        port = listener.getsockname()[1]
        settings = settings_of(view_sockets, bind="127.0.0.1", port=port, **DEFAULTS | options)
        jar = aiohttp.CookieJar(unsafe=True)
        async with (
            serving(settings, listener, others) as site,
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
    async with asyncio.timeout(TIMEOUT_S):
        while not (frame and kinds <= set(texts)):
            message = await live.receive()
            if message.type is aiohttp.WSMsgType.TEXT:
                found = json.loads(message.data)
                texts.setdefault(found["kind"], found)
            elif message.type is aiohttp.WSMsgType.BINARY and not message.data[5]:
                frame = message.data
    return texts, frame


def token_file(folder: Path) -> Path:
    path = folder / "token"
    path.write_text(TOKEN + "\n")
    path.chmod(0o640)
    return path


def visited(daemon: Any, **options: Any) -> AbstractAsyncContextManager[Visitor]:
    """A visitor of the page of one daemon."""
    return visiting(view_socket_path(daemon.path), **options)
