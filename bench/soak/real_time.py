"""Real-time part of a soak: `contactd simulate` and `contactd run` as processes, people and
programs at the control socket, rude clients, a recorder that comes and goes, and faults from
outside."""

import contextlib
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import msgspec
import numpy as np

from bench.rigs.processes import TIMEOUT_S, Pair, pair
from bench.rigs.rude_clients import ATTACKS, attacking
from bench.soak.invariants import Watch, false_alarms
from bench.soak.onlooker import Onlooker
from bench.soak.outside_faults import FAULTS
from bench.soak.people import Leases, Person, Step, View, hear, leader, operator, program
from bench.soak.process import Stopwatch, held
from bench.soak.record import Part, Report
from bench.soak.robot import gives_way, hand_script, write_robot
from common.errors import ContactdError
from daemon.config.load import load_robot
from daemon.config.schema import Configuration
from daemon.modes.table import Mode
from daemon.protocol.state import State
from drivers.canopen.settings import CanopenDrive
from programs.clients.client import Client

MEAN_PAUSE_S = 25.0  # between two faults, two rude clients, two recordings
RUDE_S = 2.0
LONGEST_SILENCE_S = 10.0  # of a daemon that is held up
SETTLES_S = 1.0  # after a fault's cause is gone
SAMPLES = 240


@dataclass(slots=True)
class Shared:
    """State shared by the threads; each field is written by one of them."""

    both: Pair
    part: Part
    over: threading.Event = field(default_factory=threading.Event)
    leases: Leases = field(default_factory=Leases)
    state: State | None = None  # the last one
    trouble: bool = False  # a fault is being made
    disturbed: list[tuple[float, float]] = field(default_factory=list)  # from, to [s, monotonic]
    failures: list[str] = field(default_factory=list)  # what went wrong in a thread

    def pause(self, seconds: float) -> bool:
        """Wait; whether it goes on after that."""
        return not self.over.wait(seconds)


def run_real_time(seed: int, seconds: float, report: Report = lambda share: None) -> Part:
    """Soak for so many seconds; `report` gets the share that is done. Raises ContactdError when the
    daemon does not start, or is gone."""
    # The black box keeps a minute, and touches its memory meanwhile.
    part = Part("real time", seed, warm_up_s=min(90.0, 0.2 * seconds))
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="contactd-soak-") as place:
        robot = write_robot(Path(place) / "arm")
        loaded = load_robot(robot)
        c = loaded.configuration
        script = Path(place) / "hand.yaml"
        script.write_bytes(msgspec.yaml.encode(hand_script(Random(seed), c, seconds)))
        with pair(robot, script) as both:
            shared = Shared(both, part)
            client, _, states = both.subscribed(timeout_s=LONGEST_SILENCE_S)
            with (
                client,
                contextlib.closing(Onlooker(both.events)) as onlooker,
                _inhabited(shared, Random(seed), c),
            ):
                watch = Watch(c, part.ledger, gives_way(loaded))
                offset_s = _observe(shared, states, watch, onlooker, seconds, report)
            both.daemon.terminate()
            _look_back(shared, both.daemon.wait(TIMEOUT_S))
            touches = onlooker.touches + shared.disturbed
            contacts_s = [t + offset_s for t in watch.contacts_s]
            part.counts["false alarms"] = false_alarms(contacts_s, touches)
            part.counts["contacts"] = len(contacts_s)
    part.seconds, part.took_s = seconds, time.perf_counter() - began
    return part


# --- who is there -------------------------------------------------------------------------------


@contextlib.contextmanager
def _inhabited(shared: Shared, rng: Random, c: Configuration) -> Iterator[None]:
    """People, programs, faults and rude clients, each a thread, while the block lasts."""

    def guarded(work: Callable[..., None], *arguments: object) -> None:
        try:
            work(shared, *arguments)
        except Exception as error:
            shared.failures.append(f"{work.__name__}: {error!r}")

    work: list[tuple[object, ...]] = [
        (_live, operator(Random(rng.random()), c)),
        (_live, program(Random(rng.random()), c)),
        (_live, leader(Random(rng.random()), c)),
        (_make_trouble, Random(rng.random()), c.joint_drives),
        (_be_rude, Random(rng.random())),
        (_record, Random(rng.random())),
    ]
    threads = [threading.Thread(target=guarded, args=each) for each in work]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        shared.over.set()
        for thread in threads:
            thread.join(TIMEOUT_S)


def _live(shared: Shared, person: Person) -> None:
    """A person or a program, each with a connection of its own."""
    part, leases = shared.part, shared.leases
    client: Client | None = None
    number = 0
    step = next(person)
    while shared.pause(step.wait_s):
        if (state := shared.state) is None:
            continue
        view = View(Mode(state.mode), state.armed, shared.trouble, state.link_position)
        step = person.send(view)
        try:
            if step.requests and client is None:
                client, number = Client(shared.both.door), leases.connection()
            for request in step.requests:
                if request.command == "reload":
                    continue  # it drops every reader, the watch among them
                assert client is not None
                leases.asked(request, number)
                reply = client.ask(request)
                now = time.monotonic()
                leases.answered(request, reply, number, now)
                hear(part, request, reply, reply.mode, state.time_s)
        except ContactdError:
            # Held up on purpose, or flooded: a person tries again.
            part.counts["requests without an answer"] += 1
            step = Step(wait_s=0.5)
        if step.hang_up and client is not None:
            client.close()
            leases.closed(number, time.monotonic())
            client = None
    if client is not None:
        client.close()


def _make_trouble(shared: Shared, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    while shared.pause(1.0 + rng.expovariate(1 / MEAN_PAUSE_S)):
        fault = rng.choice(FAULTS)
        shared.part.counts[f"fault: {fault.__name__.replace('_', ' ')}"] += 1
        began, shared.trouble = time.monotonic(), True
        fault(shared.both, rng, drives)
        shared.disturbed.append((began, time.monotonic() + SETTLES_S))
        shared.pause(0.2)
        shared.trouble = False


def _be_rude(shared: Shared, rng: Random) -> None:
    while shared.pause(rng.expovariate(1 / MEAN_PAUSE_S)):
        name = rng.choice(list(ATTACKS))
        shared.part.counts[f"rude: {name}"] += 1
        with attacking(name, shared.both.door):
            shared.pause(RUDE_S)


def _record(shared: Shared, rng: Random) -> None:
    """`contactctl record` for some seconds, now and then."""
    while shared.pause(rng.expovariate(1 / MEAN_PAUSE_S)):
        words = [sys.executable, "-c", "from programs.contactctl.contactctl import main; main()"]
        words += ["--socket", str(shared.both.door), "record", "--seconds", "5"]
        with tempfile.TemporaryDirectory(prefix="contactd-soak-") as place:
            file = Path(place) / "soak.mcap"
            done = subprocess.run([*words, str(file)], capture_output=True, text=True, check=False)
            complete = done.returncode == 0 and file.stat().st_size > 0
        shared.part.counts["recordings" if complete else "recordings ended early"] += 1


# --- what is seen ---------------------------------------------------------------------------------


def _observe(
    shared: Shared,
    states: Iterator[State],
    watch: Watch,
    onlooker: Onlooker,
    seconds: float,
    report: Report,
) -> float:
    """Check every State, and sample what the daemon holds and how punctual it is. Returns what must
    be added to State.time_s for the clock that all processes share [s]."""
    part, pid = shared.part, shared.both.daemon.pid
    window, first = [next(states)], next(states)
    stopwatch, every = Stopwatch(pid), max(seconds / SAMPLES, 0.5)
    offset_s = first.timing.monotonic_s - first.time_s
    next_s = first.time_s + every
    for state in states:
        now, shared.state = state.time_s, state
        leases = shared.leases
        watch.see(
            state,
            lease_until_s=leases.until_s - offset_s,
            lease_ticks=leases.ticks,
            touched=onlooker.look(),
            trouble=shared.trouble,
        )
        part.counts[f"ticks {state.mode}"] += 1
        part.counts["states that were not taken"] += state.tick - window[-1].tick - 1
        window.append(state)
        if now >= next_s:
            part.sample(now - first.time_s, _figures(window, pid, stopwatch))
            window, next_s = [state], next_s + every
            report((now - first.time_s) / seconds)
        if now >= first.time_s + seconds:
            break
    part.counts["deadlines missed"] = window[-1].timing.missed
    return offset_s


def _figures(window: Sequence[State], pid: int, stopwatch: Stopwatch) -> dict[str, float]:
    lateness = [state.timing.lateness_us for state in window]
    return {
        **held(pid),
        "theta's uncertainty": 1e3 * float(np.mean([s.phi_sigma for s in window])),
        "CPU time of a tick": stopwatch.per_tick_us(window[-1].tick),
        "lateness, median": float(np.median(lateness)),
        "lateness, 99 %": float(np.percentile(lateness, 99)),
        "time of a tick": float(np.median([state.timing.work_us for state in window])),
        "time of the doors": float(np.median([state.timing.doors_us for state in window])),
    }


def _look_back(shared: Shared, code: int) -> None:
    """Check how it ended, and the log."""
    check, end = shared.part.ledger.check, shared.part.times_s[-1]
    check("SIGTERM ends it in good order", code in (0, 69), end, f"exit status {code}")
    log = shared.both.log.read_text()
    words = log[log.find("Traceback") :][:500]
    check("no traceback in the log", "Traceback" not in log, end, words)
    check("the bench's own people are well", not shared.failures, end, "; ".join(shared.failures))
    shared.part.counts["lines in the log"] = len(log.splitlines())
