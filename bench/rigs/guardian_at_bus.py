"""Guardian at an end of a virtual bus of its own, a turn at a time, on the arm's clock."""

from dataclasses import dataclass

import can

from drivers.damiao.guardian import Guardian
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
            self.guardian.take(now, message.arbitration_id, message.data)
        for can_id, data in () if self.killed else self.guardian.step(now):
            frame = can.Message(arbitration_id=can_id, data=bytes(data), is_extended_id=False)
            self.end.send(frame)
