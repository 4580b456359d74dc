"""Arms of other machines on the page: shown as by `contactd fleet`, stopped, nothing more."""

import asyncio
import json
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from programs.web.contactd_web import main
from programs.web.elsewhere import MOST_SHOWN, MOST_STOPS, Router, shown_of
from programs.web.guard import COMMAND_HEADER
from programs.web.words import Elsewhere, Other, Outcome
from programs.zenoh.fleet import Arm
from tests.programs.web.page_server import page_of
from tests.programs.web.screens import PHONE, Screens
from tests.programs.web.visitor import TIMEOUT_S, visited
from tests.programs.zenoh.bridge import Bridge, until
from tests.programs.zenoh.zenoh_router import free_port, router_of

FakeDaemon = Any  # of tests/fake_daemon.py

LEFT = Other("hall/left", "alive", False, "tracking", True, "OK", "tracking, armed", "")
STOP = {COMMAND_HEADER: "stop"}


class Others:
    """Arms that a test names."""

    def __init__(self) -> None:
        self.arms = [LEFT]
        self.stopped: list[str] = []
        self.answer: Mapping[str, Outcome] | None = {"hall/left": Outcome("stands", "stands")}

    def shown(self) -> Elsewhere:
        return Elsewhere("", self.arms)

    async def stop(self, name: str) -> Mapping[str, Outcome] | None:
        self.stopped.append(name)
        return self.answer

    def close(self) -> None:
        pass


async def test_arms_of_others_and_their_changes_are_sent(fake_daemon: FakeDaemon) -> None:
    others = Others()
    async with visited(fake_daemon, others=others) as visitor:
        live = await visitor.live()

        async def reported() -> Any:
            async with asyncio.timeout(TIMEOUT_S):
                while True:
                    message = await live.receive()
                    if isinstance(message.data, str) and '"elsewhere"' in message.data:
                        return json.loads(message.data)

        assert [arm["arm"] for arm in (await reported())["arms"]] == ["hall/left"]
        others.arms = []
        while (await reported())["arms"]:
            pass
        await live.close()


async def test_one_or_all_are_stopped(fake_daemon: FakeDaemon) -> None:
    others = Others()
    async with visited(fake_daemon, others=others) as visitor:
        for query in ("?arm=hall%2Fleft", "?arm=", ""):
            status, text = await visitor.ask("POST", f"/elsewhere/stop{query}", **STOP)
            assert status == 200
            assert json.loads(text)["arms"]["hall/left"]["outcome"] == "stands"
        others.answer = None
        assert (await visitor.ask("POST", "/elsewhere/stop", **STOP))[0] == 503
    assert others.stopped == ["hall/left", "", "", ""]


REFUSED = [
    ("POST", "/elsewhere/stop", {}, {}, 403),  # without the header
    ("POST", "/elsewhere/stop", STOP, {"read_only": True}, 403),
    ("POST", "/elsewhere/stop", {**STOP, "Origin": "http://evil.example"}, {}, 403),
    ("POST", "/elsewhere/stop?arm=absent", STOP, {}, 404),
    ("POST", "/elsewhere/stop?arm=**", STOP, {}, 404),
    ("GET", "/elsewhere/stop", STOP, {}, 405),
    ("POST", "/elsewhere/arm", {COMMAND_HEADER: "arm"}, {}, 404),
    ("POST", "/elsewhere/disarm", {COMMAND_HEADER: "disarm"}, {}, 404),
]


@pytest.mark.parametrize(("method", "path", "headers", "options", "status"), REFUSED)
async def test_other_requests_are_refused(
    fake_daemon: FakeDaemon, method: str, path: str, headers: Any, options: Any, status: int
) -> None:
    others = Others()
    async with visited(fake_daemon, others=others, **options) as visitor:
        found, _ = await visitor.ask(method, path, **headers)
        assert found == status
    assert others.stopped == []


async def test_without_a_fleet_there_is_no_such_route(fake_daemon: FakeDaemon) -> None:
    async with visited(fake_daemon) as visitor:
        assert (await visitor.ask("POST", "/elsewhere/stop", **STOP))[0] == 404


# --- at a router ---------------------------------------------------------------------------------


@pytest.fixture
def arm_elsewhere(fake_daemon: FakeDaemon) -> Iterator[tuple[int, FakeDaemon]]:
    """Port of a router, which a test begins, and an arm that comes there."""
    port = free_port()
    bridge = Bridge(fake_daemon.path, f"tcp/127.0.0.1:{port}", "hall/left")
    yield port, fake_daemon
    bridge.close()


def test_arms_appear_with_a_router_and_are_silent_after_it(
    arm_elsewhere: tuple[int, FakeDaemon],
) -> None:
    port, daemon = arm_elsewhere
    with closing(Router(f"tcp/127.0.0.1:{port}", 0, "jazzy")) as others:
        assert others.shown().arms == []
        with router_of(port):
            (arm,) = until(lambda: [one for one in others.shown().arms if one.mode])
            assert (arm.arm, arm.state, arm.armed) == ("hall/left", "alive", True)
            found = until(lambda: asyncio.run(others.stop("")))
            assert found == {"hall/left": Outcome("stands", "stands")}
        until(lambda: others.shown().arms[0].silent)
        assert "silent for" in others.shown().arms[0].state
        assert asyncio.run(others.stop("hall/left")) == {"hall/left": Outcome("no answer", "")}
    assert "stop" in [command for command, _ in daemon.seen]


@pytest.mark.parametrize(("more", "words"), [(0, ""), (3, "3 more arms are not shown")])
def test_the_number_of_arms_without_room_is_shown(more: int, words: str) -> None:
    arms = [Arm(f"arm_{i:03}", frozenset({"node"})) for i in range(MOST_SHOWN + more)]
    shown = shown_of(arms, 0.0)
    assert len(shown.arms) == MOST_SHOWN
    assert shown.why.startswith(words)
    assert bool(shown.why) == bool(words)


def test_stops_that_wait_are_bounded() -> None:
    async def flood(others: Router) -> list[Any]:
        return await asyncio.gather(*[others.stop("a") for _ in range(MOST_STOPS + 3)])

    class Slow:
        def stop(self, names: list[str]) -> dict[str, tuple[str, str]]:
            time.sleep(0.2)
            return {}

    with closing(Router("tcp/127.0.0.1:1", 0, "jazzy")) as others:
        others._supervisor = Slow()  # type: ignore[assignment]
        assert asyncio.run(flood(others)) == [{}] * MOST_STOPS + [None] * 3


@pytest.mark.parametrize("where", ["localhost:7447", "/nowhere.json5", ""])
def test_a_wrong_router_is_refused(where: str, tmp_path: Path) -> None:
    words = ["--port", "0", "--no-recordings", "--fleet", where, str(tmp_path / "view")]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 78
    assert "contactd-web: " in result.output
    assert "--connect" not in result.output


# --- in a browser --------------------------------------------------------------------------------


def test_an_arm_elsewhere_is_a_tab_and_a_row_and_can_be_stopped(
    screens: Screens, arm: FakeDaemon, arm_elsewhere: tuple[int, FakeDaemon]
) -> None:
    port, daemon = arm_elsewhere
    options = ("--no-recordings", "--fleet", f"tcp/127.0.0.1:{port}")
    with page_of(arm.path, options=options) as page:
        screen = screens.live(f"{page.url}?scene=off", PHONE)
        with router_of(port):
            screen.shows("#tabs a[data-elsewhere]", "▶")
            screen.reads("#elsewhere tbody th", "hall/left")
            screen.shows("#elsewhere tbody tr", "armed")
            screen.until("document.documentElement.scrollWidth <= innerWidth")
            screen.until(  # its word in one line
                "(b => b.offsetWidth > b.offsetHeight)(document.querySelector('#elsewhere button'))"
            )
            screen.page.click("#elsewhere tbody button")
            screen.reads("#elsewhere-note", "hall/left: it stands.")
            screen.page.click("#stop-elsewhere")
            screen.data("#elsewhere-note", "kind", "good")
        screen.shows("#tabs", "silent for")
        screen.page.click("#elsewhere tbody button")
        screen.data("#elsewhere-note", "kind", "bad")
        screen.shows("#elsewhere-note", "Use the emergency stop there.")
    assert [command for command, _ in daemon.seen].count("stop") >= 2
