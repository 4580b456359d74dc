"""Screens: the page in windows of a browser, with what goes wrong in them, for tests."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
PICTURES = ROOT / "build/page"
AXE = ROOT / "page/node_modules/axe-core/axe.min.js"
TIMEOUT_MS = 60_000  # of what comes at once on a machine that has nothing else to do
DESKTOP, PHONE, WALL = (1440, 900), (360, 740), (3840, 2160)
GONE = "ERR_"  # what a browser says of a server that is gone, when a test took it away


@dataclass
class Screen:
    """One page in the browser, and what went wrong in it."""

    page: Any
    errors: list[str] = field(default_factory=list)

    def until(self, script: str) -> None:
        """Wait until an expression is true in the page."""
        self.page.wait_for_function(f"() => {script}", timeout=TIMEOUT_MS)

    def shows(self, selector: str, text: str) -> None:
        """Wait until the visible text of an element contains `text`."""
        self._says(selector, f".includes({json.dumps(text)})")

    def begins(self, selector: str, text: str) -> None:
        """Wait until the visible text of an element begins with `text`."""
        self._says(selector, f".startsWith({json.dumps(text)})")

    def reads(self, selector: str, text: str) -> None:
        """Wait until the visible text of an element is `text`."""
        self._says(selector, f" === {json.dumps(text)}")

    def data(self, selector: str, name: str, value: str) -> None:
        """Wait until a data attribute of an element is `value`."""
        element = f"document.querySelector({json.dumps(selector)})"
        self.until(f"{element}?.dataset.{name} === {json.dumps(value)}")

    def hides(self, selector: str) -> None:
        self.page.wait_for_selector(selector, state="hidden", timeout=TIMEOUT_MS)

    def counts(self, selector: str, number: int) -> None:
        """Wait until there are as many elements."""
        self.until(f"document.querySelectorAll({json.dumps(selector)}).length === {number}")

    def _says(self, selector: str, condition: str) -> None:
        self.until(f"document.querySelector({json.dumps(selector)})?.innerText{condition}")

    def live(self) -> None:
        self.until("!document.body.classList.contains('stale')")

    def old(self) -> None:
        self.until("document.body.classList.contains('stale')")

    def picture(self, name: str) -> None:
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=PICTURES / f"{name}.png")

    def faults_of_access(self) -> list[str]:
        """Findings of axe that are serious or critical."""
        self.page.evaluate(AXE.read_text())
        found = self.page.evaluate("axe.run().then((result) => result.violations)")
        return [
            f"{one['id']}: {one['nodes'][0]['html'][:120]}"
            for one in found
            if one["impact"] in ("serious", "critical")
        ]


class Screens:
    """Opens pages in one browser, and sees at the end that nothing went wrong in them."""

    def __init__(self, launched: Any) -> None:
        self._browser = launched
        self._opened: list[Screen] = []

    def open(self, url: str, size: tuple[int, int] = DESKTOP, scheme: str = "light") -> Screen:
        viewport = {"width": size[0], "height": size[1]}
        context = self._browser.new_context(viewport=viewport, color_scheme=scheme)
        screen = Screen(context.new_page())
        screen.page.on("pageerror", lambda error: screen.errors.append(str(error)))
        screen.page.on(
            "console",
            lambda said: (
                screen.errors.append(f"{said.text} {said.location.get('url')}")
                if said.type == "error"
                else None
            ),
        )
        screen.page.goto(url)
        self._opened.append(screen)
        return screen

    def live(self, url: str, size: tuple[int, int] = DESKTOP, scheme: str = "light") -> Screen:
        """An opened page, once it is live."""
        screen = self.open(url, size, scheme)
        screen.live()
        return screen

    def close(self) -> list[str]:
        errors = [error for screen in self._opened for error in screen.errors if GONE not in error]
        for screen in self._opened:
            screen.page.context.close()
        self._opened.clear()
        return errors
