"""Simulated arm as seen from the bus: plant, sensors, drives and a hand, stepped by `advance`."""

from collections.abc import Callable, Sequence
from typing import Any

import can
import msgspec
import numpy as np

from common.arrays import Vector
from common.errors import ConfigurationError
from simulator.damiao.models import DamiaoMake
from simulator.damiao.motor import DamiaoMotor
from simulator.description import ArmDescription, SimulationSettings
from simulator.drive import Drive
from simulator.events import Listener, SimulationEvent
from simulator.hand import Hand
from simulator.hand_script import AnyAct
from simulator.mismatch import steady_steps, true_gears, true_parameters
from simulator.motor import Motor
from simulator.motor_laws import MotorLaws
from simulator.plant import Plant
from simulator.robstride.models import RobStrideMake
from simulator.robstride.motor import RobStrideMotor
from simulator.sensors import Sensors
from simulator.servo import SERVO_PERIOD_S, Servo
from simulator.servo_periods import ServoPeriods
from simulator.surroundings import Surroundings

NMT, SYNC = 0x000, 0x080
SDO_REQUEST, HEARTBEAT = 0x600, 0x700


class SimulatedArm:
    """Arm whose drives take frames by `receive` and emit frames by `send`; time passes only in
    `advance`.

    At a SYNC every drive samples, sends its TPDOs, and then applies the RPDOs received before; they
    are in force until the next SYNC.
    """

    def __init__(
        self,
        description: ArmDescription,
        settings: SimulationSettings,
        send: Callable[[can.Message], None],
        *,
        hand_script: Sequence[AnyAct] = (),
        on_event: Listener = lambda _: None,
    ) -> None:
        """Raises ConfigurationError or ModelError for an invalid description or script."""
        self._per_period = round(SERVO_PERIOD_S / settings.step_s)
        if abs(self._per_period * settings.step_s - SERVO_PERIOD_S) > 1e-12:
            raise ConfigurationError(f"simulation: step_s = {settings.step_s}, must divide 1 ms")
        parameters = true_parameters(description, settings)
        if (finer := steady_steps(settings, parameters)) > self._per_period:
            self._per_period = finer
            settings = msgspec.structs.replace(settings, step_s=SERVO_PERIOD_S / finer)
            parameters = true_parameters(description, settings)
        self.description, self.settings = description, settings
        n = len(description.joints)
        self.plant = Plant(
            parameters,
            settings.step_s,
            settings.law,
            true_gears(description, settings, parameters.torque_constant),
        )
        self.servo = Servo(description, parameters.usual_link)
        self._laws = MotorLaws(self.servo)
        makes = description.drives()
        sensors = Sensors(description, settings, self.plant.q, [drive.make for drive in makes])
        self.sense = sensors.read
        """Reading of the drives' sensors; replace it to simulate faulty sensors."""
        self._periods = ServoPeriods(
            self.servo, sensors, self.plant.masses, parameters.torque_constant, self._laws
        )
        self._touching = self.plant.touched_by(self._touch)
        self.hand = Hand(
            hand_script,
            [joint.name for joint in description.joints],
            0.3 * parameters.lightest_link / settings.step_s,
            lambda given: self.plant.carry(given.mass, given.com),
            self.plant.weight,
            self.plant.pressed,
            parameters.torque_constant
            * np.array([joint.max_current_A for joint in description.joints]),
            parameters.coulomb[:n] + parameters.coulomb[n:],
            (parameters.lower, parameters.upper),
        )
        self.external_torque = np.zeros(n)
        """Torque on the links in addition to the hand's (n,) [Nm]; writable, for tests and benches.
        """
        self._send, self._on_event = send, on_event
        wired = Surroundings(
            description,
            makes,
            self.servo,
            self._laws,
            self.plant,
            self._put,
            self._sample_if_moved,
            self._report_drive,
            lambda: self.now,
        )
        self._nodes = tuple(_node(joint, wired) for joint in range(n))
        self.drives = tuple(node for node in self._nodes if isinstance(node, Drive))
        self.motors: tuple[Any, ...] = tuple(
            node for node in self._nodes if isinstance(node, Motor)
        )
        """CANopen drives, and motors of other makes, each in the order of the joints."""
        self._by_node = {drive.node: drive for drive in self.drives}
        if len({joint.node for joint in description.joints}) != n:
            raise ConfigurationError("simulated arm: two joints share a node ID")
        # Cache of drives by the identifier of an RPDO; cleared by SDO and NMT, which may change it.
        self._receivers: dict[int, tuple[Drive, ...]] = {}
        self._steps = self._sampled_at = 0
        self._sample()

    @property
    def now(self) -> float:
        """Simulated time since power-on [s]."""
        return self._steps * self.settings.step_s

    @property
    def tau_ext(self) -> Vector:
        """True external torque of the last step (n,) [Nm]; a view."""
        return self.plant.external_torque

    def power_on(self) -> None:
        """Switch all drives on: those with CANopen send their boot-up message."""
        for node in self._nodes:
            node.boot()

    def advance(self, t: float) -> None:
        """Simulate up to time t [s], rounded down to whole steps."""
        target = int(t / self.settings.step_s + 1e-6)
        per_period = self._per_period
        while self._steps < target:
            phase = self._steps % per_period
            if phase == 0:
                self._due()
            touch = self._touching if self.hand.touching else None
            periods = self._undisturbed((target - self._steps) // per_period)
            if phase == 0 and periods:
                self._periods.run(periods, per_period, touch)
                self._steps += periods * per_period
                continue
            if phase == 0:
                self._periods.begin()
            steps = min(per_period - phase, target - self._steps)
            self._periods.advance(steps, touch)
            self._steps += steps

    def answers_at(self) -> float | None:
        """Simulated time at which the next delayed SDO answer is due [s]; None if there is none."""
        times = [drive.answers_at for drive in self.drives]
        return min((t for t in times if t is not None), default=None)

    def skip(self, t: float) -> None:
        """Advance the drives' clocks to simulated time t [s] without moving the plant."""
        target = int(t / self.settings.step_s + 1e-6)
        self._steps = max(self._steps, target - target % self._per_period)

    def receive(self, message: can.Message) -> None:
        """Take a frame from the bus, at the present simulated time."""
        if message.is_remote_frame or message.is_error_frame:
            return
        cob, data = message.arbitration_id, bytes(message.data)
        extended = message.is_extended_id
        for motor in self.motors:
            if motor.extended is extended:
                motor.on_frame(cob, data)
        if self.motors:
            self._begin_hand(any(motor.moves for motor in self.motors))
        if self.drives and not extended:
            self._hear(cob, data)

    def _hear(self, cob: int, data: bytes) -> None:
        """Take a CANopen frame."""
        if cob == SYNC:
            self._sync()
        elif cob == NMT:
            self._receivers.clear()
            if len(data) >= 2:
                for drive in self.drives:
                    if data[1] in (0, drive.node):
                        drive.on_nmt(data[0])
        elif cob & 0x780 == SDO_REQUEST:
            node = self._by_node.get(cob & 0x7F)
            if node is not None:
                node.on_sdo(data)
                self._receivers.clear()
        elif cob & 0x780 == HEARTBEAT:
            for drive in self.drives:
                drive.on_heartbeat(cob & 0x7F, self.now)
        else:
            for drive in self._receivers.get(cob) or self._receivers_of(cob):
                drive.on_pdo(cob, data)

    def _receivers_of(self, cob: int) -> tuple[Drive, ...]:
        hearers = tuple(drive for drive in self.drives if drive.pdos.listens(cob))
        self._receivers[cob] = hearers
        return hearers

    def _sync(self) -> None:
        self._sample()
        for drive in self.drives:
            drive.transmit()
        for drive in self.drives:
            drive.latch()
        self._begin_hand(bool(self.servo.target.any()))

    def _begin_hand(self, moves: bool) -> None:
        if moves and not self.hand.began:
            self.hand.begin(self.now)

    def _due(self) -> None:
        """Perform the actions of drives and hand that are due at the start of a servo period."""
        now = self.now
        for node in self._nodes:
            if node.due <= now:
                node.tick(now)
        if self._handled:
            for words in self.hand.update(now, self.plant.q, SERVO_PERIOD_S):
                self._on_event(SimulationEvent(now, "hand", words))
        self.plant.external_torque[:] = self.external_torque

    @property
    def _handled(self) -> bool:
        """True while the hand acts, or has acts left in its script."""
        return self.hand.busy or (self.hand.began and not self.hand.done)

    def _undisturbed(self, most: int) -> int:
        """Number of whole servo periods from now on, at most `most`, that can be run in one call:
        neither drives nor hand have to act at the start of any but the first."""
        if most < 2 or self._handled:
            return min(most, 1)
        due, step_s, steps = min(node.due for node in self._nodes), self.settings.step_s, 0
        for periods in range(1, most):
            steps += self._per_period
            if due <= (self._steps + steps) * step_s:
                return periods
        return most

    def _touch(self, q: Vector, q_dot: Vector, out: Vector) -> None:
        out[:] = self.external_torque
        self.hand.torque(q, q_dot, out)

    def _sample_if_moved(self) -> None:
        if self._steps != self._sampled_at:
            self._sample()

    def _sample(self) -> None:
        plant = self.plant
        readings = self.sense(plant.q, plant.theta, self._laws.seen(plant.theta_dot))
        rows = zip(
            readings.link_position,
            readings.motor_position,
            readings.motor_velocity,
            readings.current,
            strict=True,
        )
        for node, row in zip(self._nodes, rows, strict=True):
            node.measure(*row)
        self._sampled_at = self._steps

    def _put(self, cob_id: int, data: bytes, extended: bool = False) -> None:
        self._send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=extended))

    def _report_drive(self, text: str) -> None:
        self._on_event(SimulationEvent(self.now, "drive", text))


def _node(joint: int, wired: Surroundings) -> Drive | Motor:
    make = wired.drives[joint].motor
    if isinstance(make, DamiaoMake):
        return DamiaoMotor(joint, wired, make)
    if isinstance(make, RobStrideMake):
        return RobStrideMotor(joint, wired, make)
    return Drive(joint, wired)
