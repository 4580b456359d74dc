"""Measurements of `bench.loop`: recorded drives, the real loop, cyclictest beside it."""

import contextlib
import json
import logging
import multiprocessing
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import can
import msgspec
import numpy as np
from can.interfaces.virtual import VirtualBus
from numpy.typing import NDArray

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT, TRUSTED, lockstep_rig
from daemon.assembly import build_boot, build_tick
from daemon.config.load import Robot
from daemon.config.schema import Configuration, Sinusoid
from daemon.modes.table import Event, Mode
from daemon.run import sleep_until
from daemon.service.notify import Notifier
from daemon.service.realtime import FIFO_PRIORITY, go_realtime
from daemon.service.service import Service
from daemon.service.socket import ControlSocket
from daemon.service.status import Process
from daemon.tick.loop import Clock, Loop
from drivers.can.virtual import QueueWire
from drivers.ids import HEARTBEAT, NEXT_PDO, NODE, SYNC, TPDO

TPDOS: Final = set(range(TPDO, TPDO + 4 * NEXT_PDO, NEXT_PDO))
# Above, frames of seven drives would not fit on a bus of 1 Mbit/s.
MOST_HZ_OF_SEVEN: Final = 250
# What the recorded session does, and when [s].
ENABLE_S, START_S, STEADY_S, END_S = 0.1, 0.7, 1.2, 3.2
# Sampled on a grid, and played to wake-ups that are not: so slow that this is no blow.
SWAY: Final = Sinusoid(amplitude=0.002, frequency_Hz=1 / (END_S - STEADY_S))
WARM_UP_TICKS: Final = 50
LONGEST_US: Final = 100_000  # of cyclictest's histogram

Answers = list[tuple[can.Message, ...]]


@dataclass(frozen=True, slots=True)
class Distribution:
    """Figures in us with how often each came up, in rising order."""

    values: NDArray[np.float64]
    counts: NDArray[np.int64]

    def at(self, percent: float) -> float:
        """The smallest value that so many per cent do not exceed."""
        share = np.cumsum(self.counts) / max(self.counts.sum(), 1)
        return float(self.values[min(np.searchsorted(share, percent / 100.0), share.size - 1)])

    def beyond(self, limit: float) -> int:
        """Number of larger ones."""
        return int(self.counts[self.values > limit].sum())

    def data(self) -> dict[str, float]:
        """Percentiles for JSON."""
        return {f"p{p:g}": round(self.at(p), 1) for p in (50, 90, 99, 99.9, 100)}


@dataclass(frozen=True, slots=True)
class Run:
    """One run of one arm at one rate."""

    hz: int
    joints: int
    seconds: float
    realtime: list[str]
    mode: str  # at the end: anything else than tracking says that something was wrong
    missed: int
    drift_us: float
    lateness_us: Distribution
    cpu_us: Distribution  # of this thread, without the recorded drives
    work_us: Distribution  # from wake-up to the last frame sent, with the recorded drives
    cyclictest_us: Distribution | None
    why_no_cyclictest: str = ""
    waited: bool = True  # for its deadlines: lateness and work are of real time

    def data(self) -> dict[str, Any]:
        """Measurements for JSON."""
        cyclictest = self.cyclictest_us.data() if self.cyclictest_us else self.why_no_cyclictest
        return {
            "joints": self.joints,
            "seconds": self.seconds,
            "ticks": int(self.lateness_us.counts.sum()),
            "missed": self.missed,
            "mode": self.mode,
            "realtime": self.realtime,
            "lateness_us": self.lateness_us.data(),
            "cyclictest_us": cyclictest,
            "cpu_us": self.cpu_us.data(),
            "work_us": self.work_us.data(),
            "drift_us": round(self.drift_us, 1),
        }


class RecordedDrives:
    """Far end of the virtual bus that answers each SYNC, inside its sending, with the simulated
    drives' answers of that tick; the steady part of the recording is played over and over.

    Time goes on while a SYNC is left out.
    """

    def __init__(
        self,
        near: VirtualBus,
        answers: Answers,
        steady_from: int,
        period_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._inbox = near.queue
        self._answers, self._steady_from = answers, steady_from
        self._period_s, self._clock = period_s, clock
        self._tick = -1
        self._synced_s = clock()
        self.cpu_s = 0.0  # taken by the answers so far

    def put_nowait(self, message: can.Message) -> None:
        """Take a frame, in the place of a queue of the virtual bus."""
        if message.arbitration_id != SYNC:
            return
        begun, now = time.thread_time(), self._clock()
        ticks = 1 if self._tick < 0 else max(round((now - self._synced_s) / self._period_s), 1)
        self._tick, self._synced_s = self._tick + ticks, now
        if self._tick >= len(self._answers):
            beyond = self._tick - self._steady_from
            self._tick -= beyond - beyond % (len(self._answers) - self._steady_from)
        for answer in self._answers[self._tick]:
            self._inbox.put_nowait(answer)
        self.cpu_s += time.thread_time() - begun


def in_a_row() -> Clock:
    """A clock on which waiting takes no time, and nothing else takes any."""
    now = 0.0

    def jump(to: float) -> None:
        nonlocal now
        now = max(now, to)

    return Clock(lambda: now, jump, lambda: now)


def measure(hz: int, seconds: int, *, load: bool, waits: bool = True) -> Run:
    """Record the drives, then run the daemon's loop against them: in real time, or, if it does not
    wait, tick by tick as fast as they come."""
    robot, answers = record(hz)
    ticks = hz * seconds
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="contactd-bench-")))
        logging.getLogger("contactd").setLevel(logging.ERROR)  # no group `contact` is no news here
        control = stack.enter_context(ControlSocket(folder / "control"))
        near = stack.enter_context(VirtualBus("bench.loop"))
        clock = Clock(time.monotonic, sleep_until, time.time) if waits else in_a_row()
        drives = RecordedDrives(near, answers, round(STEADY_S * hz), 1.0 / hz, clock.now)
        near.channel.append(drives)  # type: ignore[arg-type]  # a queue, as far as it is used
        wire = QueueWire(near)
        tick = build_tick(robot, wire, clock.now, TRUSTED)
        if load:
            stack.enter_context(hogs(2 * (os.cpu_count() or 1)))
        cyclictest = Cyclictest(hz, seconds, folder / "cyclictest.json")
        if waits:
            stack.enter_context(cyclictest)
        realtime = go_realtime()
        loop = Loop(tick, clock, 1.0 / hz)
        boot = build_boot(robot, wire)  # of no use: nothing is asked of the drives
        service = Service(Process(robot, os.getpid(), realtime), loop, control, Notifier(), boot)
        figures = np.zeros((ticks, 3))  # lateness, CPU time, work [s]
        begun = time.thread_time()

        def doors() -> None:
            nonlocal begun
            service.doors()
            number, now = tick.number, time.thread_time()
            assert tick.last is not None
            figures[number] = tick.last.wakeup.lateness_s, now - begun - drives.cpu_s, loop.work_s
            begun, drives.cpu_s = now, 0.0
            if number in (round(ENABLE_S * hz), round(START_S * hz)):
                event = Event.ENABLE if number < START_S * hz / 2 else Event.START
                assert not (why := tick.controller.request(event, "the bench", loop.time_s)), why

        tick.drives.start(0.0)
        loop.run(doors, lambda: tick.number < ticks - 1)
        beside, why = cyclictest.result() if waits else (None, "")
    figures = 1e6 * figures[WARM_UP_TICKS:]
    third = len(figures) // 3
    drift = np.median(figures[-third:, 0]) - np.median(figures[:third, 0])
    lateness, cpu, work = (_distribution(column) for column in figures.T)
    return Run(
        hz=hz,
        joints=len(robot.configuration.joints),
        seconds=seconds,
        realtime=[grant.text for grant in realtime],
        mode=tick.controller.machine.mode.value,
        missed=loop.missed,
        drift_us=abs(float(drift)),
        lateness_us=lateness,
        cpu_us=cpu,
        work_us=work,
        cyclictest_us=beside,
        why_no_cyclictest=why,
        waited=waits,
    )


def _distribution(figures: NDArray[np.float64]) -> Distribution:
    values, counts = np.unique(np.round(figures, 1), return_counts=True)
    return Distribution(values, counts)


def record(hz: int) -> tuple[Robot, Answers]:
    """The simulated drives' answers to each SYNC of a session: enabled, then swaying."""

    def configure(c: Configuration) -> Configuration:
        trajectory = msgspec.structs.replace(
            c.trajectory, ramp_s=0.3, sinusoids={c.joint_names[0]: SWAY}
        )
        return msgspec.structs.replace(c, period_ms=1000 // hz, trajectory=trajectory)

    folder = ROMEO if hz <= MOST_HZ_OF_SEVEN else SINGLE_JOINT
    with lockstep_rig(folder, configure=configure) as rig:
        nodes = {joint.wiring.node for joint in rig.robot.configuration.joints}
        answers: Answers = []
        with can.Bus(interface="virtual", channel=rig.line.channel) as ear:
            while rig.time_s < END_S:
                if rig.ticks == round(ENABLE_S * hz) + 1:
                    rig.request(Event.ENABLE)
                if rig.ticks == round(START_S * hz) + 1:
                    rig.request(Event.START)
                rig.step()
                heard = iter(lambda: ear.recv(0.0), None)
                answers.append(tuple(m for m in heard if _of_a_drive(m, nodes)))
        assert rig.mode is Mode.TRACKING, rig.tick.controller.machine.cause
        return rig.robot, answers


def _of_a_drive(message: can.Message, nodes: set[int]) -> bool:
    node = message.arbitration_id & NODE
    service = message.arbitration_id - node
    return node in nodes and (service in TPDOS or service == HEARTBEAT)


@contextlib.contextmanager
def hogs(count: int) -> Iterator[None]:
    """Processes that do nothing else than take CPU time, with an ordinary priority."""
    processes = [multiprocessing.Process(target=_burn, daemon=True) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def _burn() -> None:
    while True:
        pass


class Cyclictest:
    """cyclictest at the same interval and priority, while the block lasts; silent where it cannot
    be had."""

    def __init__(self, hz: int, seconds: int, report: Path) -> None:
        self._report = report
        program = shutil.which("cyclictest")
        self._words = [
            *(program or "", "--quiet", "--mlockall", f"--priority={FIFO_PRIORITY}"),
            *(f"--interval={1_000_000 // hz}", f"--duration={seconds}", "--threads=1"),
            *(f"--histogram={LONGEST_US}", f"--json={report}"),
        ]
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Cyclictest":
        if self._words[0]:
            self._process = subprocess.Popen(
                self._words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is not None and self._process.returncode is None:
            self._process.terminate()
            self._process.communicate()

    def result(self) -> tuple[Distribution | None, str]:
        """Latencies, or None and the reason why there are none."""
        if self._process is None:
            return None, "cyclictest is not installed (apt install rt-tests)"
        _, said = self._process.communicate()
        if self._process.returncode != 0 or not self._report.exists():
            return None, f"cyclictest failed: {said.strip()}"
        thread = json.loads(self._report.read_text())["thread"]["0"]
        histogram = {int(us): count for us, count in thread["histogram"].items()}
        if (lost := int(thread["cycles"]) - sum(histogram.values())) > 0:
            # Beyond the histogram there is only the largest one.
            histogram[int(thread["max"])] = histogram.get(int(thread["max"]), 0) + lost
        pairs = sorted(histogram.items())
        values = np.array([us for us, _ in pairs], dtype=np.float64)
        return Distribution(values, np.array([count for _, count in pairs])), ""
