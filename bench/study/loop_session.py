"""Session of `bench.loop`: the daemon's real loop, tick and sockets on python-can's virtual bus.

Asked for a number of ticks, it returns one figure of each kind per tick. Between two requests the
loop's clock is stopped, so that its arm does not notice. The drives are a recording of the
simulated ones, taken in lockstep just before; they answer each SYNC while it is sent, and their CPU
time is subtracted. It runs in a process of its own, with the daemon's real-time set-up.
"""

import contextlib
import logging
import math
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import can
import msgspec
import numpy as np
from can.interfaces.virtual import VirtualBus

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT, TRUSTED, lockstep_rig
from daemon.assembly import build_arming_checks, build_tick
from daemon.config.load import Robot
from daemon.config.schema import Configuration, Sinusoid
from daemon.drives import build_boot, build_canopen
from daemon.modes.table import Event, Mode
from daemon.run import sleep_until
from daemon.service.notify import Notifier
from daemon.service.realtime import go_realtime
from daemon.service.service import Service
from daemon.service.socket import ControlSocket
from daemon.service.status import Process
from daemon.tick.loop import Clock, Loop
from drivers.can.virtual import QueueWire
from drivers.canopen.ids import HEARTBEAT, NEXT_PDO, NODE, RPDO, SYNC, TPDO

TPDOS: Final = set(range(TPDO, TPDO + 4 * NEXT_PDO, NEXT_PDO))
RPDOS: Final = set(range(RPDO, RPDO + 4 * NEXT_PDO, NEXT_PDO))
MOST_HZ_OF_SEVEN: Final = 250  # Above, frames of seven drives would not fit on a bus of 1 Mbit/s
# Times of the events of the recorded session [s].
ENABLE_S, START_S, STEADY_S, END_S = 0.1, 0.7, 1.2, 3.2
# Sampled on a grid, but played at wake-ups that are not: slow enough for that not to matter.
SWAY: Final = Sinusoid(amplitude=0.002, frequency_Hz=1 / (END_S - STEADY_S))
FIGURES: Final = ("lateness_us", "cpu_us", "work_us", "setpoint_us")

Answers = list[tuple[can.Message, ...]]


class RecordedDrives:
    """Far end of the virtual bus that answers each SYNC, while it is sent, with the simulated
    drives' answers of that tick; the steady part of the recording is repeated.

    A SYNC that is left out advances the recording.
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
        self._answered_s = 0.0
        self.cpu_s = 0.0  # taken by the answers so far
        self.setpoint_s = math.nan  # from the last answer to a SYNC to the last setpoint after it

    def put_nowait(self, message: can.Message) -> None:
        """Take a frame, in place of a queue of the virtual bus."""
        if message.arbitration_id != SYNC:
            if message.arbitration_id & ~NODE in RPDOS:
                self.setpoint_s = time.perf_counter() - self._answered_s
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
        self.setpoint_s, self._answered_s = math.nan, time.perf_counter()


class StandingClock:
    """CLOCK_MONOTONIC without the time in which nothing is asked of the loop."""

    def __init__(self) -> None:
        self._stood_s = 0.0
        self._stopped_s = time.monotonic()

    def stop(self) -> None:
        self._stopped_s = time.monotonic()

    def go_on(self) -> None:
        self._stood_s += time.monotonic() - self._stopped_s

    def now(self) -> float:
        """Time [s]."""
        return time.monotonic() - self._stood_s

    def sleep_until(self, deadline: float) -> None:
        """Wait until this clock shows `deadline` [s]."""
        sleep_until(deadline + self._stood_s)


def in_a_row() -> Clock:
    """Clock on which only waiting advances, and takes no real time."""
    now = 0.0

    def jump(to: float) -> None:
        nonlocal now
        now = max(now, to)

    return Clock(lambda: now, jump, lambda: now)


class Session:
    """Process in which the loop runs. Raises EOFError if it ends early; stderr has why."""

    def __init__(self, hz: int, *, waits: bool) -> None:
        self._options = (hz, waits)
        self._begin()

    def _begin(self) -> None:
        spawned = multiprocessing.get_context("spawn")
        self.connection, theirs = spawned.Pipe()
        self._process = spawned.Process(target=_serve, args=(theirs, *self._options), daemon=True)
        self._process.start()
        theirs.close()
        self.connection.recv()

    def close(self) -> None:
        """End the process and wait for it."""
        self.connection.close()
        self._process.join()

    def begin_anew(self) -> None:
        """Replace the process by a new one."""
        self.close()
        self._begin()

    def ask(self, ticks: int) -> dict[str, Any]:
        """Figures of so many ticks. Raises EOFError if the process ends before; stderr has why."""
        self.connection.send(ticks)
        answer: dict[str, Any] = self.connection.recv()
        return answer


def _serve(connection: Connection, hz: int, waits: bool) -> None:
    with running(hz, waits=waits) as answer, contextlib.suppress(EOFError):
        connection.send(None)
        while True:
            connection.send(answer(connection.recv()))


@contextlib.contextmanager
def running(hz: int, *, waits: bool) -> Iterator[Callable[[int], dict[str, Any]]]:
    """Loop that is enabled, then tracking; it waits for its deadlines, or ticks on at once."""
    robot, answers = record(hz)
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="contactd-bench-")))
        logging.getLogger("contactd").setLevel(logging.ERROR)  # no group `contact` here
        control = stack.enter_context(ControlSocket(folder / "control"))
        near = stack.enter_context(VirtualBus("bench.loop"))
        standing = StandingClock()
        clock = Clock(standing.now, standing.sleep_until, time.time) if waits else in_a_row()
        drives = RecordedDrives(near, answers, round(STEADY_S * hz), 1.0 / hz, clock.now)
        near.channel.append(drives)  # type: ignore[arg-type]  # a queue, as far as it is used
        wire = QueueWire(near)
        # The boot is not used: the drives are not queried.
        arm = build_canopen(robot, build_boot(robot, wire), wire, clock.now)
        tick = build_tick(robot, arm, TRUSTED)
        realtime = go_realtime()
        process = Process(robot, os.getpid(), realtime)
        loop = Loop(tick, clock, 1.0 / hz)
        service = Service(
            process, loop, build_arming_checks(robot, tick, TRUSTED), control, Notifier(), arm
        )
        figures: list[tuple[float, ...]] = []
        begun = time.thread_time()

        def doors() -> None:
            nonlocal begun
            service.doors()
            now = time.thread_time()
            assert tick.last is not None
            spent = (tick.last.wakeup.lateness_s, now - begun - drives.cpu_s)
            figures.append((*spent, loop.work_s, drives.setpoint_s))
            begun, drives.cpu_s = now, 0.0
            if tick.number in (round(ENABLE_S * hz), round(START_S * hz)):
                event = Event.ENABLE if tick.number < START_S * hz / 2 else Event.START
                assert not (why := tick.controller.request(event, "the bench", loop.time_s)), why

        def answer(ticks: int) -> dict[str, Any]:
            nonlocal begun
            standing.go_on()
            figures.clear()
            begun, end = time.thread_time(), tick.number + ticks
            loop.run(doors, lambda: tick.number < end)
            standing.stop()
            rows = 1e6 * np.array(figures).T
            return {
                **{name: row.tolist() for name, row in zip(FIGURES, rows, strict=True)},
                "missed": loop.missed,
                "mode": tick.controller.machine.mode.value,
                "joints": len(robot.configuration.joints),
                "realtime": [grant.text for grant in realtime],
            }

        arm.start(0.0)
        standing.stop()
        yield answer


def record(hz: int) -> tuple[Robot, Answers]:
    """Simulated drives' answers to each SYNC of a session: enabled, then swaying."""

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
