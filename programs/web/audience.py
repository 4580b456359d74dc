"""Browsers that watch one arm, each with its own queue.

A browser that does not keep up loses the oldest frames, which it recognises by their ticks. Its
memory is bounded, and no other browser waits for it.
"""

import asyncio
from collections import deque

MOST_WAITING = 60  # frames, two seconds


class Browser:
    """Queue of one browser, with binary frames and texts to be sent."""

    def __init__(self) -> None:
        self._frames: deque[bytes] = deque(maxlen=MOST_WAITING)
        self._texts: deque[str] = deque(maxlen=4 * MOST_WAITING)
        self._ready = asyncio.Event()
        self.left_out = 0  # dropped frames

    def frame(self, frame: bytes) -> None:
        """Queue a frame, dropping the oldest if the queue is full."""
        self.left_out += len(self._frames) == MOST_WAITING
        self._frames.append(frame)
        self._ready.set()

    def text(self, text: str) -> None:
        """Queue a text, which is sent before all queued frames."""
        self._texts.append(text)
        self._ready.set()

    async def next(self) -> str | bytes:
        """Next message, once there is one."""
        await self._ready.wait()
        message: str | bytes = self._texts.popleft() if self._texts else self._frames.popleft()
        if not self._texts and not self._frames:
            self._ready.clear()
        return message


class Audience:
    """All browsers of one arm."""

    def __init__(self) -> None:
        self._browsers: set[Browser] = set()

    def __len__(self) -> int:
        return len(self._browsers)

    def add(self, browser: Browser) -> None:
        """Include a browser from now on."""
        self._browsers.add(browser)

    def remove(self, browser: Browser) -> None:
        """Remove a browser."""
        self._browsers.discard(browser)

    def frame(self, frame: bytes) -> None:
        """Send a frame to all."""
        for browser in self._browsers:
            browser.frame(frame)

    def text(self, text: str) -> None:
        """Send a text to all."""
        for browser in self._browsers:
            browser.text(text)
