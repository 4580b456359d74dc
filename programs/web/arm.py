"""One arm on the page: reads its daemon's States from the view socket and sends them to all
browsers that show it.

One subscription serves all browsers. Thirty times a second all States are read that have arrived;
the kernel buffers them in between, so that no tick is lost.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from common.errors import ContactdError, ControlError, ModelError
from daemon.protocol.replies import Status
from daemon.protocol.requests import GetStatus, Subscribe
from daemon.protocol.state import Snapshot, State, format_refusal
from programs.clients.client import decoded
from programs.clients.link import Link, ask_once
from programs.recordings.touch_point import TouchFinder
from programs.web import frames, words
from programs.web.audience import Audience, Browser

FRAMES_PER_S: Final = 30.0
PAST_S: Final = 20.0  # length of the curves that a new browser gets
EVENTS_KEPT: Final = 300
RETRY_S: Final = 0.25
STATUS_EVERY_S: Final = 2.0  # while a browser watches; sooner if `_asks_anew` is true
STATUS_SPACING_S: Final = 0.2  # least time between two requests
SOUGHT: Final = 3  # last States of a frame in which a point of contact is sought
# Timeout of States, as a frozen daemon keeps its socket open.
SILENT_S: Final = 1.0

_states = msgspec.json.Decoder(State)
_encode = msgspec.json.Encoder().encode


def as_text(message: msgspec.Struct) -> str:
    """Message as JSON text for browsers."""
    return _encode(message).decode()


class Arm:
    """Arm number `number`, with its daemon's view socket at `path`; `greet` makes the first message
    to a browser."""

    def __init__(self, number: int, path: Path, greet: Callable[["Arm"], words.Hello]) -> None:
        self.number, self.path, self._greet = number, path, greet
        self.name = path.stem.removesuffix("-view")
        self.audience = Audience()
        self.snapshot: Snapshot | None = None
        self.words: words.Words | None = None
        self.advice: words.Advice | None = None
        self.why_gone = "not connected yet"
        self.states = 0  # received
        self.lost = 0  # ticks missing between them
        self._last_tick = -1
        self._past: deque[bytes] = deque(maxlen=round(PAST_S * FRAMES_PER_S))
        self._events: deque[words.Event] = deque(maxlen=EVENTS_KEPT)
        self._changed = asyncio.Event()  # set if the Status may have changed, or a browser joined
        self._before: State | None = None
        self._finder: TouchFinder | None = None  # of the point of contact

    # --- browsers ---------------------------------------------------------------------------

    def join(self, browser: Browser) -> None:
        """Send a browser the present state and the past, then everything from now on."""
        browser.text(as_text(self._greet(self)))
        for message in (self.words, self.advice):
            if message is not None:
                browser.text(as_text(message))
        browser.text(as_text(words.Events(list(self._events), past=True)))
        if self.snapshot is None:
            browser.text(as_text(words.Gone(self.why_gone)))
        for first in range(0, len(self._past), frames_at_once := 30):
            some = list(self._past)[first : first + frames_at_once]
            browser.frame(b"".join(_with_length(frame) for frame in some))
        self.audience.add(browser)
        self._changed.set()

    def _add_events(self, news: list[words.Event]) -> None:
        if news:
            self._events.extend(news)
            self.audience.text(as_text(words.Events(news)))

    # --- the daemon -------------------------------------------------------------------------

    async def follow(self) -> None:
        """Receive States forever; reconnect whenever the daemon is gone."""
        while True:
            try:
                async with await Link.open(self.path) as link:
                    await self._subscribe(link)
                    await self._take(link)
            except ContactdError as error:
                self._lose(str(error))
            await asyncio.sleep(RETRY_S)

    async def _subscribe(self, link: Link) -> None:
        status = (await link.ask(GetStatus())).status
        reply = await link.ask(Subscribe())
        snapshot = reply.snapshot
        if snapshot is None:
            raise ControlError(reply.refusal)
        if refusal := format_refusal(snapshot.format):
            raise ControlError(f"the daemon has another version: its States are {refusal}")
        self.snapshot, self.words, self.why_gone = snapshot, None, ""
        try:
            self._finder = TouchFinder.of(snapshot)
        except ModelError:
            self._finder = None  # the browser reports that the arm cannot be drawn
        self._last_tick = -1
        self._before = None
        self._past.clear()
        if status is not None:
            self.name = status.name
            self._show(status)
        self.audience.text(as_text(self._greet(self)))

    def _lose(self, why: str) -> None:
        if why != self.why_gone or self.snapshot is not None:
            self.audience.text(as_text(words.Gone(why)))
        self.snapshot = self.words = None
        self.why_gone = why

    async def _take(self, link: Link) -> None:
        """Read what has arrived, 30 times a second, until the daemon is gone or silent."""
        loop = asyncio.get_running_loop()
        at_s = heard_s = loop.time()
        while True:
            packets = link.waiting()
            at_s = max(at_s + 1.0 / FRAMES_PER_S, loop.time())
            if packets:
                heard_s = loop.time()
                self._publish([decoded(_states, packet) for packet in packets])
            elif loop.time() - heard_s > SILENT_S:
                raise ControlError("the daemon fell silent")
            await asyncio.sleep(at_s - loop.time())

    def _publish(self, states: list[State]) -> None:
        snapshot = self.snapshot
        assert snapshot is not None
        for state in states:
            if self._last_tick >= 0:
                self.lost += max(state.tick - self._last_tick - 1, 0)
            self._last_tick = state.tick
        self.states += len(states)
        frame = frames.encode(states, snapshot.joints)
        self._past.append(frames.as_past(frame))
        if _asks_anew(self._before, states[-1]):
            self._changed.set()
        self._before = states[-1]
        seen = self._finder if self.audience else None
        touches = [seen.see(state) for state in states[-SOUGHT:]] if seen else [None]
        now = words.words(self.number, states[-1], touches[-1])
        if now != self.words:
            self.words = now
            self.audience.text(as_text(now))
        self._add_events([event for state in states for event in words.events(state)])
        self.audience.frame(_with_length(frame))

    # --- what the daemon has to be asked for ------------------------------------------------

    async def inquire(self) -> None:
        """Request a Status periodically while a browser watches, and sooner after a change."""
        while True:
            try:
                async with asyncio.timeout(STATUS_EVERY_S):
                    await self._changed.wait()
            except TimeoutError:
                pass
            self._changed.clear()
            if not self.audience or self.snapshot is None:
                continue
            try:
                status = (await ask_once(self.path, GetStatus())).status
            except ContactdError:
                continue  # `follow` reports it
            if status is not None:
                self._show(status)
            await asyncio.sleep(STATUS_SPACING_S)

    def _show(self, status: Status) -> None:
        advice = words.advice(status)
        if advice != self.advice:
            self.advice = advice
            self.audience.text(as_text(advice))


def _asks_anew(before: State | None, now: State) -> bool:
    """True if mode, permission or the set of joints above their levels changed, so that the last
    Status is outdated."""
    return before is None or _status_key(before) != _status_key(now)


def _status_key(state: State) -> tuple[str, bool, list[bool]]:
    return state.mode, state.armed, [excess != 0.0 for excess in state.thresholded]


def _with_length(frame: bytes) -> bytes:
    """Frame preceded by its length, as a message may contain several."""
    return len(frame).to_bytes(4, "little") + frame
