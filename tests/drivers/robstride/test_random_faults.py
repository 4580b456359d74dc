"""Random faults of RobStride motors and their bus, held to what Damiao's are."""

import pytest

from bench.rigs.lockstep import BEAM
from drivers.can.wire import EXTENDED
from drivers.motors.guardian import BEAT
from drivers.robstride.frames import HOST, Kind, identifier, kind_of, sender_of
from simulator.robstride.motor import OVERLOAD, RUN
from tests.drivers.damiao.test_random_faults import Chaos, Run, run_of


class RobStrideChaos(Chaos):
    """The same in frames of 29 bits."""

    def sender_of(self, can_id: int) -> int | None:
        return sender_of(can_id) if kind_of(can_id) == Kind.FEEDBACK else None

    def falsified(self, can_id: int) -> tuple[int, bytes]:
        status = int(self.random.choice([0x00, 0x80, 0x90, 0x01, 0x40]))
        return can_id & ~(0xFF << 16) | status << 16, self.random.bytes(8)

    def spoiled(self, can_id: int, data: bytes) -> bytes:
        if kind_of(can_id) == Kind.FEEDBACK and self.random.random() < self.spoil:
            kept = int(self.random.integers(2, 8))
            return data[:kept] + self.random.bytes(int(self.random.choice([0, 8 - kept])))
        return data


class RobStrideRun(Run):
    """The same of motors whose smallest gives 4.8 Nm."""

    powered, overload, hand_Nm = RUN << 6, OVERLOAD, 4.0

    def is_enable(self, can_id: int, data: bytes) -> bool:
        return kind_of(can_id) == Kind.ENABLE

    def foreign(self, joint: int) -> int:
        pick = self.random.integers
        of_motor = int(pick(256)) << 8 | joint + 1
        can_id = (
            int(pick(0x7F0)),
            EXTENDED | int(pick(1 << 29)),
            identifier(Kind.FEEDBACK, of_motor, HOST),
            identifier(Kind.FEEDBACK, 0x80 << 8 | joint + 1, int(pick(256))),
            identifier(int(pick(32)), 0xAA, joint + 1),
            BEAT,
        )[pick(6)]
        language = self.rig.drives._language
        if (zeroed := language.zeroed(can_id)) is not None:
            self.p[zeroed] = None  # an old p might throw it: a new one is where its torque says
        return can_id


@pytest.mark.parametrize("seed", [*range(24), 7000, 7032])
def test_random_faults(seed: int) -> None:
    run_of(seed, BEAM, RobStrideChaos, RobStrideRun)
