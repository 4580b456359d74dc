"""Debian's firefox-esr without a window, driven by WebDriver BiDi, which it speaks itself: a second
engine for the page, as playwright drives only a Firefox of its own."""

import base64
import contextlib
import json
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import aiohttp

TIMEOUT_S = 60.0
KEYS = {"Tab": "\ue004", "Escape": "\ue00c"}  # of WebDriver


def firefox() -> str | None:
    """Path of a Firefox on this machine; None if there is none."""
    return shutil.which("firefox-esr") or shutil.which("firefox")


class Window:
    """One page in Firefox."""

    def __init__(self, connection: aiohttp.ClientWebSocketResponse) -> None:
        self._connection = connection
        self._number = 0
        self._context = ""
        self.errors: list[str] = []

    async def begin(self) -> None:
        """Begin a session with the only window there is."""
        await self._ask("session.new", capabilities={})
        await self._ask("session.subscribe", events=["log.entryAdded"])
        tree = await self._ask("browsingContext.getTree")
        self._context = tree["contexts"][0]["context"]

    async def open(self, url: str, size: tuple[int, int]) -> None:
        """Show a page in a window of this size."""
        viewport = {"width": size[0], "height": size[1]}
        await self._ask("browsingContext.setViewport", context=self._context, viewport=viewport)
        await self._ask("browsingContext.navigate", context=self._context, url=url, wait="complete")

    async def value(self, script: str) -> Any:
        """Value of an expression in the page: text, number or truth; a promise is awaited."""
        target = {"context": self._context}
        found = await self._ask(
            "script.evaluate", expression=script, target=target, awaitPromise=True
        )
        if found["type"] != "success":
            raise RuntimeError(found["exceptionDetails"]["text"])
        return found["result"].get("value")

    async def until(self, script: str) -> None:
        """Wait until an expression is true in the page. Raises TimeoutError."""
        deadline = time.monotonic() + TIMEOUT_S
        while not await self.value(f"Boolean({script})"):
            if time.monotonic() > deadline:
                raise TimeoutError(script)

    async def press(self, key: str) -> None:
        """Press a key of `KEYS`."""
        strokes = [{"type": kind, "value": KEYS[key]} for kind in ("keyDown", "keyUp")]
        keyboard = {"type": "key", "id": "keyboard", "actions": strokes}
        await self._ask("input.performActions", context=self._context, actions=[keyboard])

    async def picture(self, path: Path) -> None:
        """Write what is seen, as PNG."""
        shot = await self._ask("browsingContext.captureScreenshot", context=self._context)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(shot["data"]))

    async def _ask(self, method: str, **params: Any) -> Any:
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        await self._connection.send_json(message)
        while True:
            said = json.loads((await self._connection.receive(TIMEOUT_S)).data)
            if said.get("method") == "log.entryAdded" and said["params"]["level"] == "error":
                self.errors.append(said["params"]["text"])
            if said.get("id") == self._number:
                if said["type"] == "error":
                    raise RuntimeError(f"{method}: {said['message']}")
                return said["result"]


@contextlib.asynccontextmanager
async def window() -> AsyncIterator[Window]:
    """A window of Firefox. Raises RuntimeError where there is no Firefox, or it does not start."""
    path = firefox()
    if path is None:
        raise RuntimeError("no Firefox on this machine: apt install firefox-esr")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [path, "--headless", "--no-remote", "--profile", profile]
        command += ["--remote-debugging-port", "0"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            try:
                found = None
                while found is None:
                    line = process.stderr.readline()
                    if not line:
                        raise RuntimeError("Firefox does not start")
                    found = re.search(r"ws://\S+", line)
                async with (
                    aiohttp.ClientSession() as session,
                    session.ws_connect(f"{found.group(0)}/session", max_msg_size=0) as connection,
                ):
                    one = Window(connection)
                    await one.begin()
                    yield one
            finally:
                process.terminate()
                process.stderr.close()
