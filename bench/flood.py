"""Clients that flood, babble, cut messages off, never read, or connect a thousand times: what do
they cost the loop, and does `disarm` still come through?

    python -m bench.flood [--seconds S] [--json]

Daemon, simulated arm and attackers are processes of their own, in real time. For each attack the
loop is watched without it and with it, one after the other, in the same run: lateness of the
wake-up, time of the tick, and time of the doors (clients and log) after it. Meanwhile a person
connects anew, again and again, and disarms. A last phase has the attackers as busy as in the
attacks, but with each other instead of the daemon: what the machine itself takes away.
"""

import contextlib
import errno
import multiprocessing
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np

from bench.figures import Target, print_report
from bench.lockstep import SINGLE_JOINT
from daemon.client import Client
from daemon.messages import State, Timing
from errors import ContactdError

PATIENCE_S = 30.0
PERIOD_US = 10_000.0
ATTACKERS = 2
# Between two rounds of an attacker: it must not need a whole core of a machine that has two.
PAUSE_S = 0.002
PERSON_EVERY_S = 0.1

Attack = Callable[[str], Iterator[None]]


# --- attacks: each `next` is one round ------------------------------------------------------------


def _dial(path: str) -> socket.socket:
    one = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    with contextlib.suppress(OSError):
        one.connect(path)
    return one


def _saying(path: str, packets: list[bytes], connections: int, *, listens: bool) -> Iterator[None]:
    """Every connection says everything as fast as the daemon takes it; whoever is dropped comes
    again."""
    opened = [_dial(path) for _ in range(connections)]
    while True:
        for i, one in enumerate(opened):
            try:
                for packet in packets:
                    one.send(packet)
                while listens and one.recv(1 << 20):
                    pass
            except BlockingIOError:
                continue
            except OSError as error:
                if error.errno != errno.EMSGSIZE:  # which is too long for the kernel
                    one.close()
                    opened[i] = _dial(path)
        yield


def flood(path: str) -> Iterator[None]:
    """Requests for the longest answers, which are read."""
    return _saying(path, [b'{"command":"status"}'] * 4, 12, listens=True)


def babble(path: str) -> Iterator[None]:
    """Garbage, messages that are cut off, and 10 MB."""
    packets = [b"[" * 8000, b'{"command":"sta', bytes(range(256)) * 8, b"x" * 150_000]
    return _saying(path, [*packets, b"x" * 10_000_000], 12, listens=True)


def deaf(path: str) -> Iterator[None]:
    """Readers that never read, and those who ask and do not listen."""
    return _saying(path, [b'{"command":"subscribe"}', b'{"command":"status"}'], 12, listens=False)


def upload(path: str) -> Iterator[None]:
    """Trajectories without end: the request that costs most."""
    row = "[%.3f,0.0123456789,-0.0123456789]"
    header = b'{"command":"load","header":{"name":"x","joints":["joint"]}}'
    rows = ",".join(row % (0.01 * i) for i in range(200))
    body = b'{"command":"load","rows":[%s]}' % rows.encode()
    return _saying(path, [header, body], 12, listens=True)


def crowd(path: str) -> Iterator[None]:
    """A thousand connections that stay as long as they are let."""
    held: list[socket.socket] = []
    while True:
        held += [_dial(path) for _ in range(20)]
        while len(held) > 1000:
            held.pop(0).close()
        yield


def apart(path: str) -> Iterator[None]:
    """As busy as the others, with a socket of its own."""
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    while True:
        for _ in range(48):
            near.send(b'{"command":"status"}')
            far.recv(1 << 20)
        yield


ATTACKS: dict[str, Attack] = {
    "flood": flood,
    "babble": babble,
    "deaf": deaf,
    "upload": upload,
    "crowd": crowd,
}
BESIDE: dict[str, Attack] = {"apart": apart}


def _attack(name: str, path: str) -> None:
    rounds = {**ATTACKS, **BESIDE}[name](path)
    while True:
        next(rounds)
        time.sleep(PAUSE_S)


@contextlib.contextmanager
def attacking(name: str | None, path: Path) -> Iterator[None]:
    """Processes that attack while the block lasts."""
    context = multiprocessing.get_context("fork")
    # Whoever holds a thousand connections is one, the others are many.
    count = 0 if name is None else 1 if name == "crowd" else ATTACKERS
    made = [
        context.Process(target=_attack, args=(name, str(path)), daemon=True) for _ in range(count)
    ]
    for process in made:
        process.start()
    try:
        yield
    finally:
        for process in made:
            process.kill()
            process.join()


# --- the measurement ------------------------------------------------------------------------------


@dataclass(slots=True)
class Phase:
    """What was seen during one phase."""

    name: str
    timings: list[Timing] = field(default_factory=list)
    disarms_ms: list[float] = field(default_factory=list)
    unserved: int = 0  # disarms that came to nothing

    def figures(self) -> dict[str, Any]:
        """Percentiles [us] and counts."""
        rows: dict[str, Any] = {
            what: {f"p{p}": round(float(np.percentile(values, p)), 1) for p in (50, 99, 100)}
            for what, values in self._columns().items()
        }
        missed = self.timings[-1].missed - self.timings[0].missed
        return {
            **rows,
            "ticks": len(self.timings),
            "missed": missed,
            "disarms": len(self.disarms_ms),
            "unserved": self.unserved,
            "disarm_ms": {
                "p50": round(float(np.median(self.disarms_ms)), 1) if self.disarms_ms else None,
                "max": round(max(self.disarms_ms), 1) if self.disarms_ms else None,
            },
        }

    def _columns(self) -> dict[str, list[float]]:
        return {
            "lateness_us": [t.lateness_us for t in self.timings],
            "tick_us": [t.work_us for t in self.timings],
            "doors_us": [t.doors_us for t in self.timings],
        }


def person(path: Path, phase: Phase, over: threading.Event) -> None:
    """Connects anew each time, as a command line does, and disarms."""
    while not over.wait(PERSON_EVERY_S):
        began = time.perf_counter()
        try:
            with Client(path) as client:
                done = client.request("disarm").ok
        except ContactdError:
            done = False
        if done:
            phase.disarms_ms.append(1e3 * (time.perf_counter() - began))
        else:
            phase.unserved += 1


def watch(path: Path, states: Iterator[State], name: str | None, seconds: float) -> Phase:
    """Take every State of the next `seconds` of the loop's time while `name` attacks."""
    phase = Phase(name or "quiet")
    over = threading.Event()
    somebody = threading.Thread(target=person, args=(path, phase, over))
    with attacking(name, path):
        first = next(states)
        while (state := next(states)).time_s < first.time_s + 0.3:
            pass  # until the attack is under way
        somebody.start()
        while (state := next(states)).time_s < first.time_s + 0.3 + seconds:
            phase.timings.append(state.timing)
    over.set()
    somebody.join()
    return phase


@contextlib.contextmanager
def daemon_of(folder: Path) -> Iterator[Path]:
    """The simulated arm and its daemon, each a process; the path of the control socket."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    with tempfile.TemporaryDirectory(prefix="contactd-flood-") as place:
        door = Path(place) / "control"
        program = [sys.executable, "-m", "daemon.commands.contactd"]
        simulate = [*program, "simulate", str(folder), "--port", port]
        run = [*program, "run", str(folder), "--port", port, "--socket", str(door)]
        with (
            subprocess.Popen(simulate, stdout=subprocess.PIPE) as simulator,
            (Path(place) / "log").open("w") as log,
        ):
            assert simulator.stdout is not None
            simulator.stdout.readline()  # it listens
            with subprocess.Popen(run, stderr=log) as daemon:
                try:
                    yield door
                finally:
                    daemon.terminate()
                    daemon.wait(PATIENCE_S)
                    simulator.kill()


def _subscribed(path: Path) -> tuple[Client, Iterator[State]]:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            client = Client(path)
            return client, client.subscribe()[1]
        except ContactdError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def phases(seconds: float) -> list[Phase]:
    """Quiet before each attack; at the end the busy neighbours."""
    made = []
    with daemon_of(SINGLE_JOINT) as path:
        client, states = _subscribed(path)
        with client:
            for name in [*ATTACKS, *BESIDE]:
                made += [watch(path, states, kind, seconds) for kind in (None, name)]
    return made


def _merged(some: list[Phase], name: str) -> Phase:
    merged = Phase(name)
    for phase in some:
        merged.timings += phase.timings
        merged.disarms_ms += phase.disarms_ms
        merged.unserved += phase.unserved
    return merged


@click.command(help=__doc__)
@click.option("--seconds", default=4.0, show_default=True, help="Of each phase.")
@click.option("--json", "as_json", is_flag=True)
def main(seconds: float, as_json: bool) -> None:
    made = phases(seconds)
    quiet = _merged([p for p in made if p.name == "quiet"], "quiet")
    attacked = _merged([p for p in made if p.name in ATTACKS], "attacked")
    calm, busy = quiet.figures(), attacked.figures()
    by_name = {"quiet": calm} | {p.name: p.figures() for p in made if p.name != "quiet"}
    worst_median = max(by_name[name]["doors_us"]["p50"] for name in ATTACKS)
    targets = [
        Target(
            "tick time, median, attacked over quiet",
            busy["tick_us"]["p50"] / calm["tick_us"]["p50"],
            1.5,
            "x",
            "lower",
        ),
        Target("doors, median of the worst attack", worst_median, 0.15 * PERIOD_US, "us", "lower"),
        Target("doors, p99 attacked", busy["doors_us"]["p99"], 0.3 * PERIOD_US, "us", "lower"),
        Target(
            "lateness, median, attacked less quiet",
            busy["lateness_us"]["p50"] - calm["lateness_us"]["p50"],
            0.1 * PERIOD_US,
            "us",
            "lower",
        ),
        Target("disarms that came to nothing", attacked.unserved, 0, "", "lower"),
        Target("slowest disarm attacked", busy["disarm_ms"]["max"] or np.inf, 1000, "ms", "lower"),
    ]
    if not as_json:
        click.echo(f"{os.cpu_count()} cores; us, median / p99 / max of {seconds:g} s a phase")
        for name, row in by_name.items():
            columns = "   ".join(
                f"{what} {row[f'{what}_us']['p50']:7.0f} {row[f'{what}_us']['p99']:7.0f} "
                f"{row[f'{what}_us']['p100']:7.0f}"
                for what in ("lateness", "tick", "doors")
            )
            click.echo(
                f"  {name:7} {columns}   missed {row['missed']:3}   disarm "
                f"{row['disarm_ms']['p50']} ms, {row['disarm_ms']['max']} ms at most, "
                f"{row['unserved']} not served"
            )
    print_report("flood", 0, targets, {"phases": by_name}, as_json=as_json)


if __name__ == "__main__":
    main()
