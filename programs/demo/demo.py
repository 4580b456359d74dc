"""`contactd demo`: runs simulator and daemon as two processes, with a guardian if the drives need
one, and a simulated hand, and reports on the run."""

import contextlib
import json
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table

from common.errors import ContactdError, ControlError
from common.new_file import refuse_suffix, refuse_unless_new
from contactd_client.paths import view_socket_path
from daemon.config.load import load_robot
from daemon.protocol.state import Snapshot, State
from programs.clients.client import Client
from programs.clients.dashboard import Dashboard, History
from programs.demo.demo_story import RunFigures, touch_of
from simulator.hand_script import read_script

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
HAND = "third_experiment.yaml"
START_TIMEOUT_S = 20.0
SETTLE_S = 1.5  # time at rest after the drives are enabled, before arming
ARM_TIMEOUT_S = 5.0
END_TIMEOUT_S = 10.0
FRAMES_EVERY = 10  # ticks between two frames of the dashboard


@dataclass(slots=True)
class _Run:
    """States of the run so far."""

    snapshot: Snapshot | None = None
    states: list[State] = field(default_factory=list)
    history: History = field(default_factory=History)


def run_demo(
    *,
    as_json: bool,
    seconds: float,
    arm: str,
    file: Path | None = None,
    page_port: int | None = None,
) -> bool:
    """Run the third experiment on an arm of configs/, optionally recorded to a new file; True if
    all checks pass. With `page_port` the page shows it, and a person at a terminal starts and ends
    it. Raises ContactdError."""
    if file is not None:
        refuse_suffix(file, (".mcap",))
        refuse_unless_new(file)
    robot = load_robot(where := CONFIGS / arm)
    alone = all(drive.profile.stops_alone for drive in robot.configuration.joint_drives)
    person = sys.stdout.isatty() and sys.stdin.isatty() and not as_json
    live = sys.stdout.isatty() and not as_json and page_port is None
    console = Console()
    run = _Run()
    with tempfile.TemporaryDirectory(prefix="contactd-demo-") as folder:
        door, log = Path(folder) / "control", Path(folder) / "contactd.log"
        at = (where, "--port", str(_free_port()))
        with (
            log.open("w") as log_file,
            _process("simulate", *at, "--hand", where / HAND, out=subprocess.PIPE) as sim,
            _listening(sim),
            contextlib.nullcontext() if alone else _process("guard", *at, err=log_file),
            _process("run", *at, "--socket", door, err=log_file) as daemon,
            _page(door, page_port),
        ):
            try:
                if person and page_port is not None:
                    click.pause("open it in a browser; press any key to start", err=True)
                with _recorded(daemon, door, file):
                    _play(daemon, door, run, seconds, console if live else None)
                if person and page_port is not None:
                    click.pause("the page is still served; press any key to end it", err=True)
            except ContactdError as error:
                raise ControlError(f"{error}\n{log.read_text()}".rstrip()) from error
            daemon.send_signal(signal.SIGTERM)
            daemon_ended = daemon.wait(END_TIMEOUT_S) == 0
            sim.send_signal(signal.SIGTERM)
            said, _ = sim.communicate(timeout=END_TIMEOUT_S)
        events = [json.loads(line) for line in said.splitlines()]
    assert run.snapshot is not None
    touch = touch_of(events, read_script(where / HAND))
    figures = RunFigures(robot.configuration, run.snapshot, run.states, touch)
    report = figures.report(ended_well=daemon_ended and sim.returncode == 0)
    if as_json:
        click.echo(json.dumps(report))
    else:
        _print_report(console, figures, robot.model.hand, report["pass"], ended=daemon_ended)
        if file is not None:
            console.print(f"recorded: {file} (`contactd plot {file}`)", soft_wrap=True)
    return bool(report["pass"])


def _play(
    daemon: subprocess.Popen[str], door: Path, run: _Run, seconds: float, console: Console | None
) -> None:
    """Act as the operator: enable, arm, start; then watch, disarm and stop."""
    with _connect(daemon, door) as orders, _connect(daemon, door) as stream:
        run.snapshot, states = _subscribed(stream)
        with _picture(console) as picture:
            watch = _watch(states, run, picture, quiet=console is None)
            orders.demand("enable")
            _advance(watch, run, SETTLE_S)
            deadline = time.monotonic() + ARM_TIMEOUT_S
            while not (reply := orders.arm(seconds + ARM_TIMEOUT_S, detached=True)).ok:
                if time.monotonic() > deadline:
                    raise ControlError(reply.refusal)
                _advance(watch, run, 0.2)
            orders.demand("start")
            _advance(watch, run, seconds - SETTLE_S)
            orders.demand("disarm")
            orders.demand("stop")
            _advance(watch, run, 0.5)


@contextlib.contextmanager
def _recorded(daemon: subprocess.Popen[str], door: Path, file: Path | None) -> Iterator[None]:
    """Context that is recorded by `contactctl record` in a separate process."""
    if file is None:
        yield
        return
    with _connect(daemon, door) as client:
        _subscribed(client)  # waits until recording is possible
    with _process(
        "--socket", door, "record", file, of="contactctl.contactctl", out=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        deadline = time.monotonic() + START_TIMEOUT_S
        while not file.exists():
            if process.poll() is not None or time.monotonic() > deadline:
                raise ControlError(f"{file} was not recorded")
            time.sleep(0.02)
        yield
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=END_TIMEOUT_S)


def _advance(watch: Iterator[State], run: _Run, seconds: float) -> None:
    """Watch for `seconds` of loop time."""
    first = next(watch)
    while next(watch).time_s - first.time_s < seconds:
        pass


def _watch(
    states: Iterator[State], run: _Run, picture: Live | None, *, quiet: bool
) -> Iterator[State]:
    """States of the stream, each stored in `run` and shown."""
    assert run.snapshot is not None
    for state in states:
        run.states.append(state)
        run.history.add(state)
        if picture and state.tick % FRAMES_EVERY == 0:
            picture.update(Dashboard(run.snapshot, state, run.history.summary()), refresh=True)
        if quiet:
            for event in state.notices:
                click.echo(f"{state.time_s:8.2f} s  {event.kind:8}{event.text}", err=True)
        yield state


@contextlib.contextmanager
def _picture(console: Console | None) -> Iterator[Live | None]:
    if console is None:
        yield None
        return
    with Live(console=console, screen=True, auto_refresh=False) as live:
        yield live


def _connect(daemon: subprocess.Popen[str], door: Path) -> Client:
    """Connection to the daemon, as soon as its socket exists."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while True:
        try:
            return Client(door, START_TIMEOUT_S)  # the start is slow on a busy computer
        except ContactdError:
            if daemon.poll() is not None or time.monotonic() > deadline:
                raise ControlError("the daemon did not start; its output:") from None
            time.sleep(0.05)


def _subscribed(stream: Client) -> tuple[Snapshot, Iterator[State]]:
    """Subscribe, retrying until the drives are set up, as the daemon may not answer before."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while True:
        try:
            return stream.subscribe()
        except ContactdError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.05)


@contextlib.contextmanager
def _page(door: Path, port: int | None) -> Iterator[None]:
    """Context in which the page of the daemon at `door` is served and its address printed, unless
    there is no port."""
    if port is None:
        yield
        return
    with _process(
        "--port", port, view_socket_path(door), of="web.contactd_web", out=subprocess.PIPE
    ) as page:
        assert page.stdout is not None
        address = page.stdout.readline().strip()
        if not address:
            raise ControlError("the page did not start")
        click.echo(address, err=True)
        yield


@contextlib.contextmanager
def _process(
    *arguments: object,
    of: str = "contactd.contactd",
    out: int | None = None,
    err: IO[str] | None = None,
) -> Iterator[subprocess.Popen[str]]:
    """Context with a process `contactd ...`, or another module `of` programs, which is killed at
    the end if it still runs."""
    command = [sys.executable, "-m", f"programs.{of}", *map(str, arguments)]
    with subprocess.Popen(command, stdout=out, stderr=err, text=True) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()


@contextlib.contextmanager
def _listening(simulator: subprocess.Popen[str]) -> Iterator[None]:
    """Wait for the simulator's first line, which reports that it listens."""
    assert simulator.stdout is not None
    if "listening" not in simulator.stdout.readline():
        raise ControlError("the simulator did not start")
    yield


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _print_report(
    console: Console, figures: RunFigures, frame: str, passed: bool, *, ended: bool
) -> None:
    table = Table(title="The third experiment", title_justify="left", box=None, pad_edge=False)
    for column in ("", "expected", "measured"):
        table.add_column(column)
    for check in figures.checks():
        table.add_row("[green]yes[/]" if check.happened else "[red]NO[/]", check.what, check.figure)
    table.add_row("[green]yes[/]" if ended else "[red]NO[/]", "the processes ended properly", "")
    console.print(table)
    report = figures.report(ended_well=ended)
    late, work = report["lateness_us"], report["tick_us"]
    console.print(
        f"\nloop: {report['ticks']} ticks, {report['missed']} missed; wake-up lateness "
        f"{late['p50'] / 1000:.2f} ms (median), {late['p99'] / 1000:.2f} ms (p99), "
        f"{late['max'] / 1000:.2f} ms (max); tick {work['p50'] / 1000:.2f} ms (median), "
        f"{work['max'] / 1000:.2f} ms (max)"
    )
    if words := figures.force(frame):
        console.print(words, soft_wrap=True)
    console.print(verdict(passed, report["missed"]))


def verdict(passed: bool, missed: int) -> str:
    """Last line of the report, with rich markup; `missed` counts deadlines."""
    if passed:
        return "[bold green]all as expected[/]"
    if not missed:
        return "[bold red]it failed[/]"
    # After late ticks the daemon stops and holds, which is right but not the experiment.
    return (
        f"[bold red]it failed[/]: this computer was too busy, {missed} deadlines were missed; "
        "try again"
    )
