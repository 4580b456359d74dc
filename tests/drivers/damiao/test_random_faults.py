"""Random faults of Damiao motors and their bus: what a person at the arm may rely on."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.lockstep import OPENARM, Rig, lockstep_rig
from daemon.modes.table import Event, Mode
from drivers.can.wire import Frame, Wire
from drivers.damiao.frames import ANSWERS, ENABLE
from drivers.motors.guardian import BEAT
from drivers.motors.language import State
from programs.contactd.travels import travels
from simulator.damiao.motor import OVERLOAD

T = 0.01
FAULTS = (
    "lost", "late", "silent", "reset", "error", "nonsense", "foreign", "false", "stall", "hand",
    "taken up", "doubted",
)  # fmt: skip
STILL = 0.02  # the way of a link that is held [rad]
CARRIED = 0.12  # the same, where another of the arm falls
SETTLED = 60  # ticks
UNHEARD = 0.1  # way of a motor since it was heard [rad]
REQUESTS = (Event.STOP, Event.DISABLE, Event.ENABLE, Event.START, Event.RESET)


class Chaos:
    """Wire that loses, delays and spoils frames, and notes what the daemon sends."""

    wire: Wire

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self.lose = self.spoil = 0.0
        self.late: int | None = None  # motor
        self.false: int | None = None  # the same, of feedback that is not true
        self.queued: list[Frame] = []
        self.held: list[Frame] = []  # until the next period
        self.sent: list[tuple[int, bytes]] = []

    def before(self, wire: Wire) -> Wire:
        """This, before another wire."""
        self.wire = wire
        return self

    def receive(self, timeout: float) -> Frame | None:
        if self.queued:
            return self.queued.pop(0)
        while (frame := self.wire.receive(timeout)) is not None:
            can_id, data = frame[0], bytes(frame[1])
            if self.random.random() < self.lose:
                continue
            sender = self.sender_of(can_id)
            if sender and sender == self.false and self.random.random() < 0.1:
                can_id, data = self.falsified(can_id)
            if sender and sender == self.late:
                self.held.append((can_id, data))
                continue
            return can_id, self.spoiled(can_id, data)
        return None

    def sender_of(self, can_id: int) -> int | None:
        """Motor that answers by this identifier."""
        return can_id - ANSWERS if can_id > ANSWERS else None

    def falsified(self, can_id: int) -> tuple[int, bytes]:
        """Feedback of anything."""
        status = int(self.random.choice([0, 1, 5, 13, 14]))
        return can_id, bytes([status << 4 | can_id & 0xF]) + self.random.bytes(7)

    def spoiled(self, can_id: int, data: bytes) -> bytes:
        """Data of an answer, now and then spoiled."""
        if data[2:4] == b"\x33\x51" and self.random.random() < self.spoil:
            junk = struct.pack("<f", np.nan), self.random.bytes(4)
            return data[:4] + junk[self.random.integers(2)]
        return data

    def tick(self) -> None:
        """Let those of the last period come."""
        self.queued += self.held
        self.held = []

    def send(self, frames: Sequence[Frame]) -> None:
        kept = [(can_id, bytes(data)) for can_id, data in frames]
        self.sent += kept
        self.wire.send([f for f in kept if self.random.random() >= self.lose])


class Run:
    """One run, and what it is held to."""

    powered, overload, hand_Nm = 1, OVERLOAD, 8.0

    def __init__(self, rig: Rig, chaos: Chaos, random: np.random.Generator) -> None:
        self.rig, self.chaos, self.random = rig, chaos, random
        drives = rig.robot.configuration.joint_drives
        self.drives = drives
        self.most = [t.total for t in travels(rig.robot.configuration)]
        self.reach = [
            d.wiring.max_current_A * d.profile.Nm_per_A / d.profile.stiffness for d in drives
        ]
        self.p: list[float | None] = [None] * len(drives)
        self.sent_at = [0] * len(drives)  # tick
        self.faulted_at: np.ndarray | None = None
        self.still_at: np.ndarray | None = None
        self.still_ticks = 0
        self.limp: set[int] = set()

    def step(self) -> None:
        """One tick, and what must be true of it."""
        self.chaos.sent.clear()
        self.chaos.tick()
        self.rig.step()
        self._check_setpoints()
        enables = [frame for frame in self.chaos.sent if self.is_enable(*frame)]
        assert not enables or self.rig.mode not in (Mode.OFF, Mode.FAULTED), self.rig.mode
        self.limp |= {
            i for i, motor in enumerate(self.rig.arm.motors) if motor.status != self.powered
        }
        if self.rig.mode in (Mode.HOLDING, Mode.TRACKING):
            self.limp.clear()
        self._check_travel()
        self._check_stillness()

    def _check_setpoints(self) -> None:
        """No setpoint is further from where its motor is than the current limit allows, nor from
        the last one than its velocity takes it."""
        for can_id, data in self.chaos.sent:
            language = self.rig.drives._language
            if (joint := language.commanded(can_id)) is None:
                continue
            if (found := language.setpoint_of(joint, can_id, data)) is None:
                continue
            i, p, speed = joint, found[0], abs(found[1])
            profile, before = self.drives[i].profile, self.p[i]
            count = 2 * profile.position_max / 0xFFFF
            here = self.rig.drives._measured[i]
            motor = self.rig.arm.motors[i]
            apart = abs(p - motor.positions[0])
            assert motor.status != self.powered or apart < self.reach[i] + UNHEARD, (
                i,
                p,
                motor.positions,
            )
            assert speed < self.drives[i].velocity * 1.01 + profile.velocity_max / 0xFFF
            on = self.rig.drives.replies.statuses[i].state is State.ON
            holds = on and motor.status == self.powered
            if holds and before is not None and abs(before - here) < 0.9 * self.reach[i]:
                passed_s = (self.rig.ticks - self.sent_at[i]) * T  # one that asks may be left out
                step = (speed + profile.velocity_max / 0xFFF) * max(passed_s, T)
                assert abs(p - before) < step + 2 * count, (i, p, before, speed)
            self.p[i], self.sent_at[i] = p if holds else None, self.rig.ticks

    def _check_travel(self) -> None:
        """After a fault no joint that has power goes further than its worst travel."""
        q = self.rig.arm.plant.q
        if self.rig.mode is not Mode.FAULTED or self._pushed:
            self.faulted_at = None
            return
        if self.faulted_at is None:
            self.faulted_at = q.copy()
        beyond = np.abs(q - self.faulted_at) >= self.most
        assert not set(np.flatnonzero(beyond)) - self.limp, (q - self.faulted_at, self.limp)

    def _check_stillness(self) -> None:
        """An arm that is to stand, and is not touched, does not move by itself."""
        q = self.rig.arm.plant.q
        if self.rig.mode not in (Mode.HOLDING, Mode.OFF, Mode.FAULTED) or self._pushed:
            self.still_ticks, self.still_at = 0, None
            return
        self.still_ticks += 1
        if self.still_ticks == SETTLED:
            self.still_at = q.copy()
        if self.still_at is not None:
            most = CARRIED if self.limp else STILL
            moved = set(np.flatnonzero(np.abs(q - self.still_at) > most))
            assert not moved - self.limp, (q - self.still_at, self.limp)

    @property
    def _pushed(self) -> bool:
        return bool(self.rig.arm.external_torque.any())

    def fault(self, what: str) -> None:
        """Begin a fault, keep it for a while, end it."""
        rig, chaos, random = self.rig, self.chaos, self.random
        joint = int(random.integers(len(self.drives)))
        motor = rig.arm.motors[joint]
        ticks = int(random.integers(2, 40))
        if what in ("late", "false"):
            setattr(chaos, what, joint + 1)
        elif what in ("lost", "nonsense"):
            chaos.lose = random.uniform(0.01, 0.1) if what == "lost" else 0.0
            chaos.spoil = 0.2 if what == "nonsense" else 0.0
        elif what in ("silent", "reset", "error"):
            self._break(rig.arm.motors[joint], what)
        elif what == "taken up":
            rig.take_up(rig.robot)
            self.p = [None] * len(self.drives)
        elif what == "doubted":
            rig.drives.distrust([joint])
        elif what == "stall":
            self._stall(int(random.integers(5, 51)))
        elif what == "hand":
            rig.arm.external_torque[joint] = random.uniform(-self.hand_Nm, self.hand_Nm)
        for _ in range(ticks):
            if what == "foreign":
                can_id = self.foreign(joint)
                chaos.queued.append((can_id, random.bytes(int(random.integers(9)))))
            self.step()
        chaos.lose = chaos.spoil = 0.0
        chaos.late = chaos.false = None
        motor.silent = False
        rig.arm.external_torque[:] = 0.0

    def _break(self, motor: Any, what: str) -> None:
        if what == "silent":
            motor.silent = True
        elif what == "reset":
            motor.boot()
        else:
            motor.fail(self.overload)

    def is_enable(self, can_id: int, data: bytes) -> bool:
        """True for a command that gives a motor its power."""
        return data == ENABLE

    def foreign(self, joint: int) -> int:
        """Identifier of another's frame."""
        return (int(self.random.integers(0x7F0)), 0x11 + joint, BEAT)[self.random.integers(3)]

    def _stall(self, ticks: int) -> None:
        rig = self.rig
        assert isinstance(rig.guard, GuardianAtBus)
        for _ in range(ticks):
            rig.arm.advance(rig.arm.now + T)
            rig.guard()
            rig.lockstep.pump()
        rig.ticks += ticks
        self.step()
        self.p = [None] * len(self.drives)  # the guardian's last setpoint may come after our first

    def ask(self) -> None:
        """Ask for anything, as a client may."""
        self.rig.ask(REQUESTS[self.random.integers(len(REQUESTS))])

    def recover(self) -> None:
        """Reset, enable and start, as far as that is allowed."""
        for mode, event in (
            (Mode.FAULTED, Event.RESET), (Mode.OFF, Event.ENABLE), (Mode.HOLDING, Event.START)
        ):  # fmt: skip
            if self.rig.mode is mode:
                self.rig.ask(event)
            self.steps(80)

    def steps(self, count: int) -> None:
        """So many ticks."""
        for _ in range(count):
            self.step()


def run_of(seed: int, folder: Path, chaos_of: type[Chaos], run_of: type[Run]) -> None:
    """Four random faults, each with what a person may ask for after it."""
    random = np.random.default_rng(seed)
    chaos = chaos_of(random)
    with lockstep_rig(folder, between=chaos.before) as rig:
        rig.enable()
        if random.random() < 0.7:
            rig.request(Event.START)
        run = run_of(rig, chaos, random)
        run.steps(int(random.integers(20, 150)))
        for _ in range(4):
            run.fault(FAULTS[random.integers(len(FAULTS))])
            if random.random() < 0.3:
                run.ask()
            run.steps(100)
            run.recover()


@pytest.mark.parametrize("seed", range(24))
def test_random_faults(seed: int) -> None:
    run_of(seed, OPENARM, Chaos, Run)
