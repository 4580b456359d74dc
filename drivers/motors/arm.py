"""Motors of one arm over their life cycle: `drivers.api.BootableDrives`."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from common.errors import BusError, ContactdError, DriveError
from drivers.api import Report
from drivers.can.bus import BUS_FAILURES
from drivers.can.load import FrameLoad
from drivers.can.traffic import Traffic
from drivers.can.wire import IDENTIFIER, Frame, Wire
from drivers.motors.drives import MotorTick
from drivers.motors.guardian import BEAT, Activity
from drivers.motors.language import Language
from drivers.motors.language import MotorDrives as Motors

LISTEN_S: Final = 0.15  # for another master, before the start
#: Setpoints per timeout that keep holding motors from going limp.
BEATS: Final = 4


@dataclass(frozen=True, slots=True)
class MotorIdentity:
    """Identity of one motor, as far as it reports it; serial is None if it was never written."""

    words: str
    serial: int | None

    def __str__(self) -> str:
        serial = "no serial number" if self.serial is None else f"serial {self.serial}"
        return f"{self.words}, {serial}"


class Setup(Protocol):
    """Set-up of motors of one make, which is lost when their power is off. Methods block, and raise
    DriveError and BusError."""

    def identified(self, drive: Any) -> MotorIdentity:
        """Identity of a motor that matches the configuration."""

    def begin(self, drive: Any) -> Frame | None:
        """Set up a motor that may be holding; returns a frame to send after its first setpoint."""

    def set_up(self, drive: Any) -> None:
        """Set up a motor, and read back what is readable."""

    def deviation(self, drive: Any) -> str | None:
        """First setting that a motor has lost, as text; None if there is none."""

    def leave(self, drive: Any) -> None:
        """Disable a motor's timeout."""


@dataclass(frozen=True, slots=True)
class MotorMake:
    """Make of motors: factories for an arm's periodic frames, its language, and its `Setup` over a
    wire, with a function that is called repeatedly meanwhile."""

    frames: Callable[[Motors, float], Sequence[FrameLoad]]
    language: Callable[[Motors], Language]
    setup: Callable[[Wire, Callable[[], None]], Setup]


class MotorArm(MotorTick):
    """Motors in the tick, with their set-up before the first tick and between ticks."""

    def __init__(
        self,
        make: MotorMake,
        wire: Wire,
        drives: Motors,
        period_s: float,
        clock: Callable[[], float],
        bitrate: int,
        listen_s: float = LISTEN_S,
    ) -> None:
        traffic = Traffic(make.frames(drives, period_s), period_s, bitrate)
        super().__init__(wire, drives, make.language(drives), traffic, period_s, clock)
        self._setup = make.setup
        self._wire, self._drives, self._listen_s = wire, tuple(drives), listen_s
        self._identities: list[MotorIdentity] = []
        self._beat_s = min(drive.profile.master_timeout_s for drive in drives) / BEATS
        self._beaten_s = -math.inf

    @property
    def identities(self) -> tuple[str, ...]:
        """Model, firmware and serial number of each motor that was set up."""
        return tuple(map(str, self._identities))

    @property
    def serials(self) -> list[int | None]:
        """Serial number of each motor that was set up; None if it has none."""
        return [identity.serial for identity in self._identities]

    def boot_up(self, report: Report) -> None:
        """Identify, set up and read back all motors. Raises BusError (the bus fails, or another
        master is on it) or DriveError (a motor is silent, not the configured one, or does not keep
        a value)."""
        self._port.taken_over = self._held_by_guardian()
        setup = self._setup(self._wire, lambda: None)
        self._identities = []
        for drive in self._drives:
            identity = _identified(setup, drive)
            self._identities.append(identity)
            report(f"{drive}: {identity}")
        for i, drive in enumerate(self._drives):
            if (behind := setup.begin(drive)) is not None:
                self._behind[i] = behind
            report(f"{drive}: set up and read back")

    def prove(self, meanwhile: Callable[[], None], report: Report, warn: Report) -> list[int]:
        """Read back all motors, and set up again those that differ; returns their joints. Raises
        ContactdError. After any other exception no motor counts as set up."""
        setup = self._setup(self._wire, lambda: self._beat(meanwhile))
        renewed = []
        if zeroed := sorted(self._port.zeroed):
            raise DriveError(
                f"{self._named(zeroed)}: another master set a new zero, so its position is "
                "unknown. Switch off its power, correct its zero and restart the daemon"
            )
        try:
            for i, drive in enumerate(self._drives):
                problem = "silent, gone limp, or jumped" if i in self.unfit() else None
                problem = problem or setup.deviation(drive)
                if problem is None:
                    continue
                warn(f"{drive}: {problem}: setting it up again")
                self._refuse_other_motor(i, _identified(setup, drive))
                setup.set_up(drive)
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
                f"{self._identities[joint]}. To accept it, use `contactctl reload` with the drives "
                "off, or restart the daemon after a fault"
            )

    def disable_monitoring(self) -> None:
        """Disable the timeouts of all motors: those that hold keep holding. Raises the first
        DriveError after all are written."""
        setup = self._setup(self._wire, lambda: self._beat(lambda: None))
        errors = []
        for drive in self._drives:
            try:
                setup.leave(drive)
            except DriveError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def _beat(self, meanwhile: Callable[[], None]) -> None:
        """Send holding setpoints to all motors when due, and call `meanwhile`."""
        now = time.monotonic()
        if now - self._beaten_s >= self._beat_s:
            self._beaten_s = now
            self.quick_stop()
            meanwhile()

    def _held_by_guardian(self) -> bool:
        """True if a guardian holds motors. Raises BusError if another master commands them."""
        deadline, heard, held = time.monotonic() + self._listen_s, None, False
        while (remaining := deadline - time.monotonic()) > 0.0:
            try:
                frame = self._wire.receive(remaining)
            except BUS_FAILURES as error:
                raise BusError(f"the bus cannot be read: {error}") from error
            if frame is not None:
                heard = frame[0] if self._language.masters(frame[0]) else heard
                held = held or (frame[0] == BEAT and bytes(frame[1]) != bytes([Activity.WATCHES]))
        if heard is not None and not held:
            raise BusError(
                f"another master is on this bus: 0x{heard & IDENTIFIER:03X} is being sent"
            )
        return held


def _identified(setup: Setup, drive: Any) -> MotorIdentity:
    """Identity of the motor of a drive. Raises DriveError if it is not the configured one."""
    identity, wanted = setup.identified(drive), drive.wiring.serial
    if wanted is not None and identity.serial != wanted:
        raise DriveError(
            f"{drive} is another motor: serial number {identity.serial}, configured {wanted}"
        )
    return identity
