"""Lockstep part of a soak: simulated hours, every random choice from one seed.

The daemon's tick and service, the simulated arm, a hand, people, and the faults of
`bench.rigs.faults` on one virtual bus. Requests reach the service without its socket, so that no
clock of this machine decides anything.
"""

import concurrent.futures
import contextlib
import logging
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random

import numpy as np

from bench.rigs.breakable_arm import ROMEO_ARM, BreakableArm, breakable
from bench.rigs.faults import CASES, Case
from bench.rigs.lockstep import Rig, lockstep_rig
from bench.soak.invariants import Watch, false_alarms
from bench.soak.losses import LOSSES
from bench.soak.people import LAPSES_TICKS, Leases, Person, View, hear, leader, operator, program
from bench.soak.process import held
from bench.soak.record import Part, Progress, Report
from bench.soak.robot import gives_way, hand_script, write_robot
from common.arrays import Vector
from common.errors import ContactdError
from daemon.config.load import load_robot
from daemon.protocol.replies import Reply
from daemon.protocol.socket_path import Peer
from daemon.protocol.state import State
from daemon.service.notify import Notifier
from daemon.service.service import Service
from daemon.service.socket import ControlSocket
from daemon.service.status import Process
from daemon.tick.loop import Loop

# Not at random: what leaves the arm somewhere it cannot be enabled from, what ends the program,
# what needs a certain motion to be noticed, what stands in for another program's part, and what is
# stronger than a drive: no setpoint keeps it inside a joint limit.
UNFIT = {
    "adapter gone", "drive deaf to setpoints", "... and to SDO", "... and to NMT",
    "drive stone-deaf", "drive runs away", "current stuck", "encoder frozen",
    "gear slips at 0.8 rad/s", "infinite reference", "pushed beyond a limit", "hard hit",
}  # fmt: skip
# A robot has losses every day: each is drawn as often as three faults.
FAULTS = (*(case for case in CASES if case.name not in UNFIT), *LOSSES * 3)
# Ticks that an arm waits for missing samples, by the seed: the usual ones, and so many that its
# joints sense nothing before.
STALE_TICKS = (12, 3)
MEAN_PAUSE_S = 20.0  # between two faults
SAMPLES = 240


def simulate_hours(seed: int, hours: float, jobs: int) -> list[Part]:
    """Each job is a process with a seed of its own and its share of the hours."""
    spawn = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(jobs, spawn) as pool:
        return list(pool.map(_simulate, range(seed, seed + jobs), [hours / jobs] * jobs))


def _simulate(seed: int, hours: float) -> Part:
    return run_lockstep(seed, hours, Progress(f"lockstep, seed {seed}"))


class _Visitor:
    """One person or program, and their connection."""

    def __init__(self, person: Person) -> None:
        self.person = person
        self.due_s = 0.0
        self.connection = 0
        next(person)


class _Troublemaker:
    """One fault after the other, each for a while."""

    def __init__(self, rng: Random, stage: BreakableArm) -> None:
        self._rng, self._stage = rng, stage
        self._fault: Iterator[None] | None = None
        self._case: Case = FAULTS[0]
        self._next_s, self._left = rng.expovariate(1 / MEAN_PAUSE_S), 0
        self._found = False

    @property
    def active(self) -> bool:
        """True while a fault is being made."""
        return self._fault is not None

    def before(self, part: Part) -> None:
        """Before a tick: begin, go on, or end."""
        now = self._stage.rig.time_s
        if self._fault is None and now >= self._next_s:
            self._case = self._rng.choice(FAULTS)
            self._fault = self._case.fault(self._stage)
            self._left = self._case.ticks + self._rng.randrange(30)
            self._found = False
            part.counts[f"fault: {self._case.name}"] += 1
        if self._fault is not None:
            self._left -= 1
            if self._left < 0 or next(self._fault, self) is self:
                self._fault.close()  # type: ignore[attr-defined]  # all of them are generators
                self._fault = None
                self._next_s = now + self._rng.expovariate(1 / MEAN_PAUSE_S)
                part.counts["faults noticed"] += self._found

    def after(self) -> None:
        """After it: was it noticed?"""
        if self._fault is not None:
            findings = self._stage.rig.last.findings
            self._found |= any(finding.condition is self._case.condition for finding in findings)


def run_lockstep(seed: int, hours: float, report: Report = lambda share: None) -> Part:
    """Soak for so many simulated hours; `report` gets the share that is done."""
    rng = Random(seed)
    seconds = 3600.0 * hours
    part = Part(f"lockstep, seed {seed}", seed, warm_up_s=0.02 * seconds)
    began = time.perf_counter()
    with _silent_log(), tempfile.TemporaryDirectory(prefix="contactd-soak-") as folder:
        robot = write_robot(Path(folder) / "arm", STALE_TICKS[seed % len(STALE_TICKS)])
        hand = hand_script(Random(seed), load_robot(robot).configuration, seconds)
        make = replace(ROMEO_ARM, rig=partial(lockstep_rig, robot))
        with (
            breakable(make, hand=hand) as stage,
            ControlSocket(Path(folder) / "control") as control,
            contextlib.closing(Notifier()) as notifier,
        ):
            _soak(part, rng, stage, _service(stage.rig, control, notifier), seconds, report)
    part.took_s = time.perf_counter() - began
    return part


@contextlib.contextmanager
def _silent_log() -> Iterator[None]:
    """Silence the log: faults come all the time, and one line for each would bury the report."""
    logger = logging.getLogger("contactd")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _service(rig: Rig, control: ControlSocket, notifier: Notifier) -> Service:
    c = rig.robot.configuration
    loop = Loop(rig.tick, rig.clock(), c.period_s)
    # The clock of the rig starts at zero, as the loop's does.
    service = Service(
        Process(rig.robot, os.getpid(), []), loop, rig.arming, control, notifier, rig.drives
    )
    service.commands.set_up.asking = rig.by_sdo
    return service


def _soak(
    part: Part, rng: Random, stage: BreakableArm, service: Service, seconds: float, report: Report
) -> None:
    rig, c = stage.rig, stage.rig.robot.configuration
    leases = Leases()
    watch = Watch(c, part.ledger, gives_way(rig.robot))
    trouble = _Troublemaker(Random(rng.random()), stage)
    visitors = [_Visitor(who(Random(rng.random()), c)) for who in (operator, program, leader)]
    touches: list[tuple[float, float]] = []
    sampler = _Sampler(part, every_s=max(seconds / SAMPLES, 0.25))
    stage.run(0.1)
    while (now := rig.time_s) < seconds:
        trouble.before(part)
        stage.tick()
        # After the tick: a hand that began within it has moved the arm already.
        touched = rig.arm.hand.touching
        if touched or trouble.active:
            if not touches or touches[-1][1] < now - 0.5:
                touches.append((now, now))
            touches[-1] = (touches[-1][0], now)
        trouble.after()
        state, plant = rig.state(), rig.arm.plant  # as it is published
        service.doors()
        service.commands.reloading = False  # its files are as they were
        watch.see(
            state,
            lease_until_s=leases.until_s,
            lease_ticks=LAPSES_TICKS,
            touched=touched,
            trouble=trouble.active,
            q=plant.q,
            theta=plant.theta,
            motor_velocity=plant.theta_dot,
        )
        for visitor in visitors:
            if visitor.due_s <= now:
                _visit(visitor, service, leases, trouble.active, part)
        part.counts[f"ticks {state.mode}"] += 1
        if sampler.take(now, state, plant.theta):
            report(now / seconds)
    part.seconds = seconds
    part.counts["contacts"] = len(watch.contacts_s)
    part.counts["touches and faults"] = len(touches)
    part.counts["false alarms"] = false_alarms(watch.contacts_s, touches)


class _Sampler:
    """Gathers figures of ticks, and every `every_s` makes one sample of them."""

    def __init__(self, part: Part, every_s: float) -> None:
        self._part, self._every_s, self._next_s = part, every_s, every_s
        self._sigma: list[float] = []
        self._error: list[float] = []
        self._cpu_s = time.thread_time()

    def take(self, time_s: float, state: State, theta: Vector) -> bool:
        """One tick, with the motors' true positions (n,) [rad]; whether it completes a sample."""
        self._sigma.append(sum(state.phi_sigma) / len(state.phi_sigma))
        # What stands where its side of the gap is unknown may be a gap off, and says so: that comes
        # and goes with faults and with switching on.
        known = np.array([side != "unknown" for side in state.side])
        error = np.abs(np.array(state.motor_estimate) - theta)
        self._error.append(float(error.max(where=known, initial=0.0)))
        if time_s < self._next_s:
            return False
        spent = time.thread_time() - self._cpu_s
        self._part.sample(
            time_s,
            {
                **held(os.getpid()),
                "theta's uncertainty": 1e3 * float(np.mean(self._sigma)),
                "error of theta, side known": 1e3 * float(np.median(self._error)),
                "CPU time, simulation included": 1e6 * spent / len(self._sigma),
            },
        )
        self._sigma, self._error = [], []
        self._next_s += self._every_s
        self._cpu_s = time.thread_time()
        return True


def _visit(visitor: _Visitor, service: Service, leases: Leases, trouble: bool, part: Part) -> None:
    """Let a person or a program look at the arm and send their requests."""
    machine, now = service.loop.tick.controller.machine, service.loop.time_s
    last = service.loop.tick.last
    q = last.samples.link_position.tolist() if last and last.decision else ()
    step = visitor.person.send(View(machine.mode, machine.armed, trouble, q))
    if step.requests and not visitor.connection:
        visitor.connection = leases.connection()
    peer = Peer(os.getuid(), os.getpid(), visitor.connection)
    for request in step.requests:
        leases.asked(request, peer.connection)
        try:
            reply = service.commands.handle(request, peer)
        except ContactdError as error:  # as the control socket does
            reply = Reply(ok=False, message=str(error))
        leases.answered(request, reply, peer.connection, now)
        hear(part, request, reply, machine.mode, now)
    if step.hang_up and visitor.connection:
        service.control.on_close(peer)
        leases.closed(visitor.connection, now)
        visitor.connection = 0
    visitor.due_s = now + step.wait_s
