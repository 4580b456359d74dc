"""HTTP and WebSocket server of the page (aiohttp): access, live States, commands."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from aiohttp import WSMsgType, web

from daemon.protocol.text import on_behalf_of
from programs.clients.stopping import Command, carry_out
from programs.web import words
from programs.web.arm import Arm, as_text
from programs.web.audience import Browser
from programs.web.connections import asked, kept, stay
from programs.web.elsewhere_routes import ElsewhereRoutes, Others
from programs.web.guard import (
    COOKIE,
    HEADERS,
    OriginRules,
    Places,
    Refusal,
    TokenCheck,
    command_refusal,
)
from programs.web.page_routes import PageRoutes
from programs.web.recording_routes import RecordingRoutes
from programs.web.recordings import Recorder
from programs.web.replies import as_json, refused

MOST_BROWSERS: Final = 64
MOST_BROWSERS_OF_ONE: Final = 8
STUCK_S: Final = 10.0  # timeout of sending to a browser
SUMMARY_EVERY_S: Final = 0.25
BEAT_S: Final = 1.0  # longest time without a message, which shows both ends that the other is alive
MOST_SAID_BYTES: Final = 64  # largest message from a browser, which has nothing to send

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings from the command line."""

    view_sockets: tuple[Path, ...]
    origin_rules: OriginRules
    token: str
    read_only: bool
    recordings: Path | None  # None: recording is not offered
    proxied: bool  # listens on a unix socket; the proxy states the client's address


class Site:
    """The page's server: arms and browsers."""

    def __init__(self, settings: Settings, others: Others | None = None) -> None:
        self.settings, self.others = settings, others
        self.arms = [
            Arm(number, path, self.greeting) for number, path in enumerate(settings.view_sockets)
        ]
        self.token = TokenCheck(settings.token)
        self.places = Places(MOST_BROWSERS, MOST_BROWSERS_OF_ONE)
        self.recorder = Recorder(settings.recordings) if settings.recordings else None
        self._open: set[Callable[[], None]] = set()  # one to hang up on each browser
        self.jobs: list[asyncio.Task[None]] = []  # tasks that end only with an error

    def application(self) -> web.Application:
        """Application with all routes."""
        app = web.Application(middlewares=[self._guard], client_max_size=4096)
        app.router.add_get("/clock", self._clock)
        app.router.add_get("/live/{arm:[0-9]{1,3}}", self._live)
        app.router.add_get("/arms/{arm:[0-9]{1,3}}/urdf", self._urdf)
        app.router.add_post("/arms/{arm:[0-9]{1,3}}/{command:stop|disarm}", self._command)
        if self.recorder:
            RecordingRoutes(self.recorder, self._arm).add_to(app.router)
        if self.others:
            ElsewhereRoutes(self.others).add_to(app.router)
        PageRoutes(self.token, self._address, tls=self.settings.origin_rules.tls).add_to(app.router)
        app.cleanup_ctx.append(self._running)
        return app

    async def _running(self, app: web.Application) -> AsyncIterator[None]:
        follow = [arm.follow() for arm in self.arms]
        inquire = [arm.inquire() for arm in self.arms]
        jobs = (*follow, *inquire, self._summarise(), self._look_elsewhere())
        self.jobs = [asyncio.create_task(job) for job in jobs]
        yield
        for job in self.jobs:
            job.cancel()
        await asyncio.gather(*self.jobs, return_exceptions=True)
        if self.recorder:
            await self.recorder.close()

    async def _summarise(self) -> None:
        """Send all browsers the modes of all arms, for the tabs and as a sign of life."""
        loop = asyncio.get_running_loop()
        sent, sent_s = "", 0.0
        while True:
            summary = self.summary()
            if summary != sent or loop.time() - sent_s >= BEAT_S:
                sent, sent_s = summary, loop.time()
                for arm in self.arms:
                    arm.audience.text(summary)
            await asyncio.sleep(SUMMARY_EVERY_S)

    async def _look_elsewhere(self) -> None:
        """Send all browsers the arms of other computers whenever they change."""
        sent = ""
        while True:
            shown = self.elsewhere()
            if shown != sent:
                sent = shown
                for arm in self.arms:
                    arm.audience.text(shown)
            await asyncio.sleep(BEAT_S)

    def elsewhere(self) -> str:
        """Arms of other computers as JSON; empty without a router."""
        return as_text(self.others.shown()) if self.others else ""

    def summary(self) -> str:
        """Modes of all arms as JSON."""
        last = [arm.words for arm in self.arms]
        return as_text(
            words.Summary(
                [one.mode if one else "" for one in last], [bool(one and one.armed) for one in last]
            )
        )

    def greeting(self, arm: Arm) -> words.Hello:
        """First message to a browser that shows this arm."""
        may = not self.settings.read_only
        return words.hello(
            [each.name for each in self.arms],
            arm.number,
            arm.snapshot,
            may_command=may,
            may_record=may and self.recorder is not None,
        )

    def abort(self) -> None:
        """Abort all connections of browsers before the end; they reconnect by themselves."""
        for abort in list(self._open):
            abort()

    # --- who may ask --------------------------------------------------------------------------

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        asked(request.transport)
        refusal = self._refusal(request)
        if refusal is None:
            try:
                response = await handler(request)
            except web.HTTPException as error:
                response = refused(Refusal(error.status, error.reason))
        else:
            response = refused(refusal)
        if not response.prepared:
            response.headers.update(HEADERS)
            response.force_close()
        return response

    def _refusal(self, request: web.Request) -> Refusal | None:
        upgrades = request.path.startswith("/live/")
        refusal = self.settings.origin_rules.refusal(
            request.method, request.headers, upgrades=upgrades
        )
        if refusal is not None:
            return refusal
        open_to_all = request.path in ("/", "/enter", "/page.css", "/icon.svg")
        if not open_to_all and not self.token.admits(request.cookies.get(COOKIE, "")):
            return Refusal(401, "open the page first: it asks for the token")
        if command := request.match_info.get("command"):
            if self.settings.read_only:
                return Refusal(403, "this page is read-only; it cannot send commands")
            return command_refusal(command, request.headers)
        return None

    def _address(self, request: web.Request) -> str:
        if self.settings.proxied:  # only the proxy can connect, and states the client's address
            return request.headers.get("X-Real-IP", "unknown")
        return request.remote or "unknown"

    # --- arms ---------------------------------------------------------------------------------

    def _arm(self, request: web.Request) -> Arm:
        number = int(request.match_info["arm"])
        if number >= len(self.arms):
            raise web.HTTPNotFound
        return self.arms[number]

    async def _urdf(self, request: web.Request) -> web.StreamResponse:
        snapshot = self._arm(request).snapshot
        if snapshot is None:
            raise web.HTTPNotFound
        response = web.Response(text=snapshot.urdf, content_type="application/xml")
        response.enable_compression()
        return response

    # --- live ---------------------------------------------------------------------------------

    async def _clock(self, request: web.Request) -> web.StreamResponse:
        """Clock of the States' times, by which the page determines their age."""
        return web.Response(text=str(time.monotonic()))

    async def _live(self, request: web.Request) -> web.StreamResponse:
        arm, address = self._arm(request), self._address(request)
        if not self.places.take(address):
            return refused(Refusal(503, "too many pages are open"))
        try:
            socket = web.WebSocketResponse(
                max_msg_size=MOST_SAID_BYTES, compress=False, autoping=False
            )
            socket.headers.update(HEADERS)
            with kept(request.transport):
                await socket.prepare(request)
                stay(request.transport)
                browser = Browser()
                arm.join(browser)
                browser.text(self.summary())
                if shown := self.elsewhere():
                    browser.text(shown)

                def abort() -> None:
                    """Abort the connection and discard queued messages, as it may be stuck."""
                    if request.transport is not None:
                        request.transport.abort()

                self._open.add(abort)
                sending = asyncio.create_task(_send(socket, browser, abort))
                try:
                    await _until_closed(socket)
                finally:
                    self._open.discard(abort)
                    arm.audience.remove(browser)
                    sending.cancel()
                    await asyncio.gather(sending, return_exceptions=True)
                    abort()
        finally:
            self.places.leave(address)
        return socket

    # --- commands -----------------------------------------------------------------------------

    async def _command(self, request: web.Request) -> web.StreamResponse:
        command: Command = "stop" if request.match_info["command"] == "stop" else "disarm"
        arm = self._arm(request)
        who = on_behalf_of(f"the page at {self._address(request)}")
        with kept(request.transport):
            return as_json(await carry_out(arm.path, command, who))


async def _send(socket: web.WebSocketResponse, browser: Browser, abort: Callable[[], None]) -> None:
    """Send queued messages until cancelled; hang up if the browser does not receive."""
    try:
        while True:
            message = await browser.next()
            async with asyncio.timeout(STUCK_S):
                if isinstance(message, str):
                    await socket.send_str(message)
                else:
                    await socket.send_bytes(message)
    except (TimeoutError, ConnectionError):
        abort()


async def _until_closed(socket: web.WebSocketResponse) -> None:
    """Wait for the end; any other message, which our page never sends, ends the connection."""
    async for message in socket:
        if message.type is not WSMsgType.CLOSE:
            return
