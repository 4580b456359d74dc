"""Surroundings of a simulated drive: the parts of the arm that it is connected to."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from simulator.description import ArmDescription, DriveDescription
from simulator.motor_laws import MotorLaws
from simulator.plant import Plant
from simulator.servo import Servo


class Send(Protocol):
    """Way onto the bus."""

    def __call__(self, cob_id: int, data: bytes, extended: bool = False) -> None:
        """Put a frame on it; extended: its identifier has 29 bits."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Parts of the simulated arm that a drive is connected to."""

    description: ArmDescription
    drives: tuple[DriveDescription, ...]
    servo: Servo
    laws: MotorLaws
    plant: Plant
    send: Send
    sample: Callable[[], None]
    """Have the sensors measure, if time has passed since they did."""
    report: Callable[[str], None]
    now: Callable[[], float]
    """Simulated time [s]."""
