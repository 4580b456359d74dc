"""Cost of the page for daemon and machine, and age of its picture.

    python -m bench.web [--rounds N] [--seconds S] [--json]

Simulated arm, daemon, `contactd-web` and its browsers are processes of their own, in real time; the
arm holds. In each round the loop is watched without the page, and with it beside five WebSocket
clients that read and one that does not. Ratios are of the same round: p99 of the tick's work and
the doors after it (clients and log), which is all that the loop does. The doors alone take longer
by one reader, the page's only one: that is printed beside. Then a real browser, without three
dimensions: first paint, and the time from a tick to the frame that shows it, by the machine's one
clock. The exit status is 1 where a target is missed, or the browser could not be tried.
"""

import asyncio
import contextlib
import gzip
import itertools
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import aiohttp
import click
import numpy as np

from bench.options import command
from bench.report import Target, print_report
from bench.rigs.browser import browser, chromium
from bench.rigs.lockstep import ROMEO
from bench.rigs.page import page_of, ticks_in
from bench.rigs.processes import Pair, pair
from bench.soak.process import cpu_s, peak_mb
from daemon.protocol.state import State
from programs.clients.client import Client
from programs.web.page_routes import BUILT

READERS = 5
LOADS = 5
SETTLE_S = 1.0
# After the frame in which the newest tick is drawn: its number, and the Unix time [s].
WATCH = """() => {
  window.shown = [];
  const root = document.documentElement;
  const channel = new MessageChannel();
  channel.port1.onmessage = (event) =>
    window.shown.push([event.data, (performance.timeOrigin + performance.now()) / 1e3]);
  new MutationObserver(() => channel.port2.postMessage(Number(root.dataset.tick)))
    .observe(root, { attributes: true, attributeFilter: ["data-tick"] });
}"""

# Time from a click on STOP until the page says what became of it [s].
STOP = """() => new Promise((resolve) => {
  const begun = performance.now();
  const outcome = document.querySelector("#outcome");
  new MutationObserver(() => {
    if (["good", "bad"].includes(outcome.dataset.kind)) resolve((performance.now() - begun) / 1e3);
  }).observe(outcome, { attributes: true });
  document.querySelector("#stop").click();
})"""
# Unix time at which the page turns grey [s].
GREY = """() => {
  new MutationObserver(() => {
    if (document.body.classList.contains("stale") && !window.grey)
      window.grey = (performance.timeOrigin + performance.now()) / 1e3;
  }).observe(document.body, { attributes: true });
}"""


@dataclass(slots=True)
class Readers:
    """Browsers' ends of the stream, in a thread of their own."""

    url: str
    ticks: list[list[int]] = field(default_factory=lambda: [[] for _ in range(READERS)])
    bytes: int = 0
    _stop: threading.Event = field(default_factory=threading.Event)

    async def run(self) -> None:
        """Read with all but one, until told to stop."""
        headers = {"Origin": self.url.rstrip("/")}
        async with aiohttp.ClientSession() as session:
            deaf = await session.ws_connect(f"{self.url}live/0", headers=headers)
            connection = deaf._response.connection
            assert connection is not None
            assert connection.transport is not None
            transport = connection.transport
            transport.pause_reading()
            await asyncio.gather(*(self._read(session, headers, i) for i in range(READERS)))
            transport.abort()

    async def _read(self, session: aiohttp.ClientSession, headers: Any, number: int) -> None:
        async with session.ws_connect(f"{self.url}live/0", headers=headers) as socket:
            while not self._stop.is_set():
                message = await socket.receive(timeout=5.0)
                if message.type is aiohttp.WSMsgType.BINARY:
                    self.ticks[number] += ticks_in(message.data)
                    self.bytes += len(message.data)

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """Read while the block lasts."""
        thread = threading.Thread(target=lambda: asyncio.run(self.run()))
        thread.start()
        yield
        self._stop.set()
        thread.join()

    @property
    def lost(self) -> int:
        """Ticks between the first and the last of each that never came."""
        return sum(t[-1] - t[0] + 1 - len(t) for t in self.ticks if t)


def watch(both: Pair, seconds: float) -> list[State]:
    """States of so many seconds."""
    client, _, states = both.subscribed()
    with client:
        found = [next(states)]
        while found[-1].time_s - found[0].time_s < seconds:
            found.append(next(states))
    return found


def p99_us(states: list[State]) -> dict[str, float]:
    """p99 of the tick's work, of the doors, and of both together [us]."""
    tick, doors = np.array([(s.timing.work_us, s.timing.doors_us) for s in states]).T
    parts = {"both": tick + doors, "tick": tick, "doors": doors}
    return {name: float(np.percentile(part, 99)) for name, part in parts.items()}


@dataclass(slots=True)
class Rounds:
    """Figures of all rounds."""

    without: list[dict[str, float]] = field(default_factory=list)
    beside: list[dict[str, float]] = field(default_factory=list)
    lost: int = 0
    read: int = 0
    cpu: list[float] = field(default_factory=list)  # share of a core
    memory_mb: float = 0.0
    reader_kb_s: float = 0.0

    def ratio(self, what: str) -> float:
        """Median over the rounds of with over without."""
        rounds = zip(self.beside, self.without, strict=True)
        return float(np.median([there[what] / here[what] for there, here in rounds]))

    def play(self, both: Pair, seconds: float, *, page_first: bool) -> None:
        """One round; which comes first alternates."""
        if page_first:
            self._with(both, seconds)
        self.without.append(p99_us(watch(both, seconds)))
        if not page_first:
            self._with(both, seconds)

    def _with(self, both: Pair, seconds: float) -> None:
        with page_of(both.door) as page:
            readers = Readers(page.url)
            with readers.reading():
                time.sleep(SETTLE_S)
                before_s, begun_s = cpu_s(page.process.pid), time.monotonic()
                self.beside.append(p99_us(watch(both, seconds)))
                passed_s = time.monotonic() - begun_s
                self.cpu.append((cpu_s(page.process.pid) - before_s) / passed_s)
                self.memory_mb = max(self.memory_mb, peak_mb(page.process.pid))
            self.lost += readers.lost
            self.read += min(len(ticks) for ticks in readers.ticks)
            self.reader_kb_s = readers.bytes / READERS / (passed_s + SETTLE_S) / 1e3


@dataclass(frozen=True, slots=True)
class Picture:
    """Figures of the browser."""

    delays_ms: list[float]  # from each tick to the frame that shows it, or a later one
    first_paint_ms: list[float]
    live_ms: list[float]  # until the first live figures are drawn
    stop_ms: float  # from STOP until the page says what became of it
    grey_ms: float  # from the daemon's death until the page is grey


def in_browser(both: Pair, seconds: float) -> Picture:
    """Look at the page as a person does."""
    with page_of(both.door) as page, browser(webgl=False) as launched:
        loads = [load(launched, page.url) for _ in range(LOADS)]
        shown = launched.new_page(viewport={"width": 1280, "height": 800})
        shown.goto(f"{page.url}?scene=off")
        shown.wait_for_function("() => !document.body.classList.contains('stale')")
        time.sleep(SETTLE_S)
        shown.evaluate(WATCH)
        walls = {state.tick: state.timing.wall_s for state in watch(both, seconds)}
        frames = shown.evaluate("() => window.shown")
        stop_ms = 1e3 * shown.evaluate(STOP)
        shown.evaluate(GREY)
        died_s = time.time()
        both.daemon.kill()
        shown.wait_for_function("() => window.grey")
        grey_ms = 1e3 * (shown.evaluate("() => window.grey") - died_s)
    paint, live = zip(*loads, strict=True)
    return Picture(list(delays_of(frames, walls)), list(paint), list(live), stop_ms, grey_ms)


def delays_of(frames: list[tuple[int, float]], walls: dict[int, float]) -> Iterator[float]:
    """Delay of each tick [ms], from its wake-up to the first frame that shows it or a later one."""
    for (before, _), (tick, painted_s) in itertools.pairwise(frames):
        for number in range(before + 1, tick + 1):
            if number in walls:
                yield 1e3 * (painted_s - walls[number])


def load(launched: Any, url: str) -> tuple[float, float]:
    """Times of the first paint and of the first live figures [ms] of one visit."""
    context = launched.new_context()
    page = context.new_page()
    page.goto(f"{url}?scene=off")
    times = (
        "['first-contentful-paint', 'live'].map((name) => performance.getEntriesByName(name)[0])"
    )
    page.wait_for_function(f"() => {times}.every(Boolean)")
    paint, live = page.evaluate(f"() => {times}.map((entry) => entry.startTime)")
    context.close()
    return paint, live


def page_kb() -> float:
    """All that a browser loads, with three dimensions, gzipped [kB]."""
    names = ("index.html", "page.js", "scene.js", "page.css", "icon.svg")
    return sum(len(gzip.compress((BUILT / name).read_bytes())) for name in names) / 1e3


def targets_of(rounds: Rounds, picture: Picture | None) -> list[Target]:
    """Figures and what they are held against."""
    targets = [
        Target("tick and doors at p99, with over without", rounds.ratio("both"), 1.1),
        Target("states lost", rounds.lost, 0),
        Target("web process", 100 * float(np.median(rounds.cpu)), 5.0, "% of a core"),
        Target("memory of the web process", rounds.memory_mb, 80.0, "MB"),
        Target("page with three dimensions, gzipped", page_kb(), 250.0, "kB"),
    ]
    if picture is not None:
        delay = float(np.percentile(picture.delays_ms, 95))
        paint = float(np.median(picture.first_paint_ms))
        targets += [
            Target("from a tick to its pixel, p95", delay, 120.0, "ms"),
            Target("first paint", paint, 1000.0, "ms"),
            Target("from STOP to its outcome", picture.stop_ms, 1000.0, "ms"),
            Target("from a killed daemon to a grey page", picture.grey_ms, 1000.0, "ms"),
        ]
    return targets


@command(__doc__)
@click.option("--rounds", "count", default=10, type=click.IntRange(1, 100))
@click.option("--seconds", default=4.0, type=click.FloatRange(1, 60))
def main(count: int, seconds: float, as_json: bool) -> None:
    rounds, picture = Rounds(), None
    with pair(ROMEO) as both:
        client, _, _ = both.subscribed()
        client.close()
        with Client(both.door) as person:
            person.demand("enable")
        for number in range(count):
            rounds.play(both, seconds, page_first=number % 2 == 1)
        if chromium() is not None:
            picture = in_browser(both, 3 * seconds)
    targets = targets_of(rounds, picture)
    if picture is None and not as_json:
        click.echo("NOT MEASURED: no chromium here (apt install chromium)")
    if not as_json:
        alone = f"tick {rounds.ratio('tick'):.3f}, doors {rounds.ratio('doors'):.3f}"
        load_average = os.getloadavg()[0]
        click.echo(f"  p99 with over without, each alone: {alone}; load average {load_average:.1f}")
    data = {
        "rounds": count,
        "ratio_tick": rounds.ratio("tick"),
        "ratio_doors": rounds.ratio("doors"),
        "without_p99_us": rounds.without,
        "beside_p99_us": rounds.beside,
        "states_read": rounds.read,
        "reader_kb_s": rounds.reader_kb_s,
        "load_average": os.getloadavg()[0],
    }
    if picture is not None:
        p50, p99 = np.percentile(picture.delays_ms, [50, 99])
        data |= {"delay_p50_ms": p50, "delay_p99_ms": p99, "ticks_shown": len(picture.delays_ms)}
        data |= {"first_paint_ms": picture.first_paint_ms, "live_ms": picture.live_ms}
    print_report("web", 0, targets, data, as_json=as_json)
    raise SystemExit(0 if picture and all(target.met for target in targets) else 1)


if __name__ == "__main__":
    main()
