"""Guardian at an end of a virtual bus of its own, a turn at a time, on the arm's clock."""

from dataclasses import dataclass

import can

from bench.rigs.sync_clock import GUARDIAN
from drivers.can.wire import EXTENDED, IDENTIFIER, frame_of
from drivers.motors.guardian import Guardian
from simulator.arm import SimulatedArm


@dataclass(slots=True)
class GuardianAtBus:
    """Guardian of a simulated arm; a call is one turn. `killed`: it does nothing any more."""

    guardian: Guardian
    end: can.BusABC
    arm: SimulatedArm
    killed: bool = False

    def __call__(self) -> None:
        """Take the frames of the bus, and send what is due."""
        now = self.arm.now
        while (message := self.end.recv(0.0)) is not None:
            self.guardian.take(now, *frame_of(message))
        for can_id, data in () if self.killed else self.guardian.step(now):
            number, is_extended = can_id & IDENTIFIER, can_id >= EXTENDED
            self.end.send(can.Message(0.0, number, is_extended, channel=GUARDIAN, data=bytes(data)))
