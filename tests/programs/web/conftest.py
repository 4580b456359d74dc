"""The page in a real browser, over a daemon whose States a test changes.

Pictures of all states go to build/page. Any error in the browser's console fails a test, a
violation of the content security policy among them.
"""

import time
from collections.abc import Iterator
from typing import Any

import pytest
from msgspec.structs import replace

from bench.rigs.browser import browser, chromium
from daemon.protocol.state import State
from tests.fake_daemon import state_at
from tests.programs.web.page_server import Page, page_of
from tests.programs.web.screens import PHONE, Screen, Screens

FakeDaemon = Any  # of tests/fake_daemon.py


@pytest.fixture(scope="module")
def launched() -> Iterator[Any]:
    if chromium() is None:
        pytest.skip("NOT TRIED: no chromium here (apt install chromium)")
    with browser() as one:
        yield one


@pytest.fixture
def screens(launched: Any) -> Iterator[Screens]:
    opened = Screens(launched)
    yield opened
    assert opened.close() == []


@pytest.fixture
def arm(fake_daemon: FakeDaemon) -> FakeDaemon:
    """A daemon whose States have a test's changes, at about 100 Hz, by the machine's own clock."""
    begun = time.monotonic()
    fake_daemon.changes = {}

    def state(tick: int) -> State | None:
        if tick % 10:
            return None
        made = state_at(tick // 10)
        now = time.monotonic()
        timing = replace(made.timing, monotonic_s=now, wall_s=time.time())
        said = {"time_s": now - begun, "timing": timing, **fake_daemon.changes}
        return replace(made, **said)

    fake_daemon.states = state
    return fake_daemon


@pytest.fixture
def page(arm: FakeDaemon) -> Iterator[Page]:
    with page_of(arm.path) as one:
        yield one


@pytest.fixture
def screen(screens: Screens, page: Page) -> Screen:
    """The page without its scene in a wide window, live."""
    return screens.live(f"{page.url}?scene=off")


@pytest.fixture
def phone(screens: Screens, page: Page) -> Screen:
    """The page without its scene on a phone, live."""
    return screens.live(f"{page.url}?scene=off", PHONE)
