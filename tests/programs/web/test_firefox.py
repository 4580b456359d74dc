"""The page in Firefox: the same to eye, keyboard and screen reader, and to a stop."""

from typing import Any

import pytest

from tests.programs.web.firefox import Window, firefox, window
from tests.programs.web.page_server import Page
from tests.programs.web.screens import AXE, DESKTOP, PHONE, PICTURES

FakeDaemon = Any  # of tests/fake_daemon.py
FOCUS = "(e => e.id || e.name || e.localName)(document.activeElement)"
SERIOUS = """axe.run().then((result) => result.violations
  .filter((one) => ["serious", "critical"].includes(one.impact)).map((one) => one.id).join())"""

pytestmark = pytest.mark.skipif(
    firefox() is None, reason="NOT TRIED: no Firefox here (apt install firefox-esr)"
)


async def test_the_page_is_live_and_stops_the_arm_in_firefox(arm: FakeDaemon, page: Page) -> None:
    arm.modes = {"stop": ["holding"]}
    async with window() as one:
        for name, size in (("desktop", DESKTOP), ("phone", PHONE)):
            await one.open(f"{page.url}?scene=off", size)
            await one.until("!document.body.classList.contains('stale')")
            await one.until("document.querySelector('#checks li')")
            await one.until("document.documentElement.scrollWidth <= innerWidth")
            await one.picture(PICTURES / f"firefox_{name}.png")
            await sees_nothing_serious(one)
        found = []
        for _ in range(4):
            await one.press("Tab")
            found.append(await one.value(FOCUS))
        assert found == ["stop", "disarm", "summary", "mode"]
        await one.press("Escape")
        await one.until("document.querySelector('#outcome').dataset.outcome === 'stands'")
        arm.states = lambda tick: None
        await one.until("document.body.classList.contains('stale')")
        assert one.errors == []
    assert [name for name, _ in arm.seen].count("stop") == 1


async def sees_nothing_serious(one: Window) -> None:
    """Findings of axe, where there is axe."""
    if AXE.exists():
        await one.value(f"{AXE.read_text()}; 0")
        assert await one.value(SERIOUS) == ""
