"""Surroundings of a simulated drive: the parts of the arm to which it is connected."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from simulator.description import ArmDescription, DriveDescription
from simulator.motor_laws import MotorLaws
from simulator.plant import Plant
from simulator.servo import Servo


class Send(Protocol):
    """Function that sends a frame."""

    def __call__(self, cob_id: int, data: bytes, extended: bool = False) -> None:
        """Send a frame; extended: its identifier has 29 bits."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Parts of the simulated arm to which a drive is connected."""

    description: ArmDescription
    drives: tuple[DriveDescription, ...]
    servo: Servo
    laws: MotorLaws
    plant: Plant
    send: Send
    sample: Callable[[], None]
    """Sample all sensors, if time has passed since the last sample."""
    report: Callable[[str], None]
    now: Callable[[], float]
    """Simulated time [s]."""
