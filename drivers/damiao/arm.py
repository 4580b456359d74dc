"""Damiao motors of one arm over their whole life: `drivers.api.BootableDrives`.

Set-up is a few registers, written until the motor's power is off, and read back: its mode, and the
time without setpoints after which it lets go.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from common.errors import BusError, ContactdError, DriveError
from drivers.api import Report
from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import Wire
from drivers.damiao.drives import DamiaoDrives
from drivers.damiao.frames import (
    ANSWERS,
    IMPEDANCE_MODE,
    REGISTERS,
    TIMEOUT_S,
    Register,
)
from drivers.damiao.guardian import BEAT, Doing
from drivers.damiao.registers import Registers, same
from drivers.damiao.settings import FAR, DamiaoDrive

LISTEN_S: Final = 0.15  # for another master, before the start
#: Motors that hold hear a setpoint at least so often in the time that they wait for one.
BEATS: Final = 4


@dataclass(frozen=True, slots=True)
class MotorIdentity:
    """Identity of one motor, as its registers say; serial is None where it was never written."""

    model: str  # as configured: the motor does not name its own
    firmware: int
    serial: int | None

    def __str__(self) -> str:
        serial = "no serial number" if self.serial is None else f"serial {self.serial}"
        return f"{self.model}, firmware {self.firmware}, {serial}"


class DamiaoArm(DamiaoDrives):
    """Motors in the tick, and their set-up before it and between two."""

    def __init__(
        self,
        wire: Wire,
        drives: Sequence[DamiaoDrive],
        period_s: float,
        clock: Callable[[], float],
        listen_s: float = LISTEN_S,
    ) -> None:
        super().__init__(wire, drives, period_s, clock)
        self._wire, self._drives, self._listen_s = wire, tuple(drives), listen_s
        self._identities: list[MotorIdentity] = []
        self._beat_s = min(drive.profile.patience_s for drive in drives) / BEATS
        self._beaten_s = -math.inf

    @property
    def identities(self) -> tuple[str, ...]:
        """Model, firmware and serial number of each motor that was set up."""
        return tuple(map(str, self._identities))

    @property
    def serials(self) -> list[int | None]:
        """Serial number of each motor that was set up; None where it has none."""
        return [identity.serial for identity in self._identities]

    def boot_up(self, report: Report) -> None:
        """Identify, set up and read back all motors. Raises BusError (the bus fails, another master
        is there) or DriveError (a motor is silent, another one, or does not hold a register)."""
        self._port.taken_over = self._held_by_guardian()
        registers = Registers(self._wire)
        self._identities = []
        for drive in self._drives:
            identity = _identified(registers, drive)
            self._identities.append(identity)
            report(f"{drive}: {identity}")
        for drive in self._drives:
            _set_up(registers, drive)
            report(f"{drive}: set up and read back")

    def prove(self, meanwhile: Callable[[], None], report: Report, warn: Report) -> list[int]:
        """Read all motors, and set up again those that differ, whose joints are returned. Raises
        ContactdError. After any other exception the set-up of every motor is unknown."""
        registers = Registers(self._wire, lambda: self._beat(meanwhile))
        renewed = []
        try:
            for i, drive in enumerate(self._drives):
                problem = "silent, or let go by itself" if i in self.unfit() else None
                problem = problem or _deviation(registers, drive)
                if problem is None:
                    continue
                warn(f"{drive}: {problem}: setting it up again")
                self._refuse_other_motor(i, _identified(registers, drive))
                _set_up(registers, drive)
                report(f"{drive}: set up again")
                renewed.append(i)
        except ContactdError:
            raise
        except Exception:
            self.distrust(range(len(self.names)))
            raise
        return renewed

    def _refuse_other_motor(self, joint: int, identity: MotorIdentity) -> None:
        if self._identities and identity != self._identities[joint]:
            raise DriveError(
                f"{self.names[joint]} has another motor than at the start: {identity}; it was "
                f"{self._identities[joint]}. With the drives off `contactctl reload` takes it up, "
                "after a fault a new start of the daemon"
            )

    def let_go(self) -> None:
        """Switch off the motors' watch on us: those that hold go on holding. Raises
        the first DriveError after all were written."""
        registers, errors = Registers(self._wire, lambda: self._beat(lambda: None)), []
        for drive in self._drives:
            timeout_s = drive.profile.answer_timeout_ms / 1000.0
            try:
                registers.write(drive.node, Register.TIMEOUT, 0, timeout_s, str(drive))
            except DriveError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def _beat(self, meanwhile: Callable[[], None]) -> None:
        """Setpoints to all motors when it is time: those that hold would let go."""
        now = time.monotonic()
        if now - self._beaten_s >= self._beat_s:
            self._beaten_s = now
            self.quick_stop()
            meanwhile()

    def _held_by_guardian(self) -> bool:
        """True where a guardian holds motors. Raises BusError where another commands them."""
        commands = {*self._motors, REGISTERS}
        deadline, heard, held = time.monotonic() + self._listen_s, None, False
        while (remaining := deadline - time.monotonic()) > 0.0:
            try:
                frame = self._wire.receive(remaining)
            except BUS_FAILURES as error:
                raise BusError(f"the bus cannot be read: {error}") from error
            if frame is not None:
                heard = frame[0] if frame[0] in commands else heard
                held = held or (frame[0] == BEAT and bytes(frame[1]) != bytes([Doing.WATCHES]))
        if heard is not None and not held:
            raise BusError(f"another master is on this bus: 0x{heard:03X} is being sent")
        return held


def _wanted(drive: DamiaoDrive) -> dict[Register, float]:
    """Registers that are set, and their values."""
    return {
        Register.TIMEOUT: round(drive.profile.patience_s / TIMEOUT_S),
        Register.MODE: IMPEDANCE_MODE,
    }


def _ranges(drive: DamiaoDrive) -> dict[Register, tuple[str, float]]:
    """Registers that must agree with the configuration: its field and value."""
    profile = drive.profile
    return {
        Register.POSITION_MAX: ("position_max", profile.position_max),
        Register.VELOCITY_MAX: ("velocity_max", profile.velocity_max),
        Register.TORQUE_MAX: ("torque_max_Nm", profile.torque_max_Nm),
        Register.GEAR: ("model", profile.figures.gear),
        Register.MASTER_ID: ("wiring.node", drive.node + ANSWERS),
    }


def _identified(registers: Registers, drive: DamiaoDrive) -> MotorIdentity:
    """Identity of a motor whose ranges are as configured. Raises DriveError."""
    timeout_s = drive.profile.answer_timeout_ms / 1000.0

    def value(register: Register) -> float:
        return registers.read(drive.node, register, timeout_s, str(drive))

    for register, (field, wanted) in _ranges(drive).items():
        held = value(register)
        if not same(held, wanted):
            raise DriveError(
                f"{drive}: register {register.value} ({register.name.lower()}) reads {held:g}; "
                f"`{field}` of the configuration means {wanted:g}"
            )
    serial = int(value(Register.SERIAL))
    identity = MotorIdentity(
        drive.profile.model,
        int(value(Register.FIRMWARE)),
        None if serial in (0, 0xFFFFFFFF) else serial,
    )
    if drive.wiring.serial is not None and identity.serial != drive.wiring.serial:
        raise DriveError(
            f"{drive} is another motor: serial number {identity.serial}, configured "
            f"{drive.wiring.serial}"
        )
    return identity


def _set_up(registers: Registers, drive: DamiaoDrive) -> None:
    """Write what is wanted, and check that both encoders are in one unit. Raises DriveError."""
    timeout_s = drive.profile.answer_timeout_ms / 1000.0
    for register, value in _wanted(drive).items():
        registers.write(drive.node, register, value, timeout_s, str(drive))
    motor, output = (
        registers.read(drive.node, register, timeout_s, str(drive))
        for register in (Register.MOTOR_POSITION, Register.OUTPUT_POSITION)
    )
    apart = math.remainder(motor - output, math.tau)
    if not abs(apart) <= FAR:
        raise DriveError(
            f"{drive}: its motor is at {motor:.3f} rad and its output at {output:.3f} rad, "
            f"{abs(apart):.2f} rad apart; at most {FAR:g} rad is allowed: its zero may be lost, or "
            "its output has no encoder"
        )


def _deviation(registers: Registers, drive: DamiaoDrive) -> str | None:
    """First register that a motor does not hold any more, in words. Raises SilentDriveError."""
    timeout_s = drive.profile.answer_timeout_ms / 1000.0
    for register, wanted in _wanted(drive).items():
        held = registers.read(drive.node, register, timeout_s, str(drive))
        if not same(held, wanted):
            return (
                f"register {register.value} ({register.name.lower()}) reads {held:g}, not "
                f"{wanted:g}"
            )
    return None
