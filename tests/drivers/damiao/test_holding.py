"""Motors that hold: they go on while the daemon begins, asks, doubts their set-up, or ends."""

import struct
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from bench.rigs.lockstep import OPENARM, Rig, lockstep_rig
from common.errors import DriveError
from daemon.modes.table import Event, Mode
from drivers.can.wire import Frame, Wire
from drivers.damiao.frames import ANSWERS, ENABLE, Register, setpoint_of
from tests.drivers.motors.one_arm import RAISED, furthest, hold_at, powered

STILL = 0.01  # the way of a link that is held [rad]


class Tap:
    """Wire that can lose answers or change them, and notes what is sent and when, in time that is
    waited for frames: a busy machine, which makes everything late, is not in it."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.lost: set[int] = set()
        self.output: tuple[int, float] | None = None  # answer id, and what its encoder is to read
        self.sent: list[tuple[float, int, bytes]] = []
        self.waited_s = 0.0

    def receive(self, timeout: float) -> Frame | None:
        while (frame := self.wire.receive(timeout)) is not None:
            can_id, data = frame[0], bytes(frame[1])
            if can_id in self.lost:
                continue
            if self.output and can_id == self.output[0] and data[2:4] == bytes((0x33, 81)):
                return can_id, data[:4] + struct.pack("<f", self.output[1])
            return frame
        self.waited_s += timeout
        return None

    def send(self, frames: Sequence[Frame]) -> None:
        self.sent += [(self.waited_s, can_id, bytes(data)) for can_id, data in frames]
        self.wire.send(frames)


class Held:
    rig: Rig
    tap: Tap


@pytest.fixture
def held() -> Iterator[Held]:
    held = Held()

    def between(wire: Wire) -> Wire:
        held.tap = Tap(wire)
        return held.tap

    with lockstep_rig(OPENARM, between=between) as held.rig:
        hold_at(held.rig, RAISED)
        yield held


def longest_gaps(tap: Tap, since: float) -> list[float]:
    """Longest time without a setpoint for each motor [s]."""
    gaps = []
    for motor in range(1, 8):
        at = [t for t, i, data in tap.sent if i == motor and t >= since and setpoint_of(data)]
        gaps.append(max(np.diff([since, *at, tap.waited_s])))
    return gaps


# --- the daemon begins ----------------------------------------------------------------------------


def test_a_daemon_that_takes_up_an_arm_that_holds_does_not_move_it(held: Held) -> None:
    held.rig.take_up(held.rig.robot)
    assert furthest(held.rig, 1.0).max() < STILL
    assert all(powered(held.rig))


def test_no_motor_moves_where_the_first_samples_are_lost(held: Held) -> None:
    rig = held.rig
    rig.take_up(rig.robot)
    held.tap.lost = {ANSWERS + 1, ANSWERS + 2, ANSWERS + 4}
    assert furthest(rig, 0.03).max() < STILL
    heard = {i for _, i, data in held.tap.sent if setpoint_of(data)}
    assert heard.isdisjoint({1, 2, 4})  # no position is known that would hold them
    held.tap.lost = set()
    assert furthest(rig, 1.0).max() < STILL


def test_a_hold_before_the_first_sample_sends_nothing(held: Held) -> None:
    held.rig.take_up(held.rig.robot)
    held.rig.drives.quick_stop()
    assert not [i for _, i, _ in held.tap.sent if i < ANSWERS]


# --- it doubts ------------------------------------------------------------------------------------


def test_motors_whose_set_up_is_doubted_go_on_holding(held: Held) -> None:
    held.rig.drives.distrust(range(7))
    assert furthest(held.rig, 2.0).max() < STILL
    assert all(powered(held.rig))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -40.0])
def test_a_false_value_of_an_output_encoder_is_a_missing_sample(held: Held, value: float) -> None:
    held.tap.output = (ANSWERS + 2, value)
    assert furthest(held.rig, 0.02).max() < STILL
    assert held.rig.samples.fresh.tolist() == [True, False, *[True] * 5]
    assert abs(held.rig.samples.link_position[1] - -0.5) < 0.02
    held.tap.output = None
    furthest(held.rig, 0.2)
    assert held.rig.mode is Mode.HOLDING


def test_a_motor_without_an_answer_is_not_enabled() -> None:
    taps: list[Tap] = []

    def between(wire: Wire) -> Wire:
        taps.append(Tap(wire))
        return taps[-1]

    with lockstep_rig(OPENARM, between=between) as rig:
        rig.run(0.1)
        rig.request(Event.ENABLE)
        taps[-1].lost = {ANSWERS + 4}
        rig.run(0.5)
        assert (4, ENABLE) not in [(i, data) for _, i, data in taps[-1].sent]


# --- it asks --------------------------------------------------------------------------------------


def test_setpoints_reach_all_motors_while_one_stays_silent(held: Held) -> None:
    rig = held.rig
    rig.arm.motors[6].silent = True
    begun = held.tap.waited_s
    with rig.lockstep.serving(), pytest.raises(DriveError, match="joint7"):
        rig.drives.prove(lambda: None, lambda line: None, lambda line: None)
    assert max(longest_gaps(held.tap, begun)) < 0.05  # at 0.1 they let go


def test_setpoints_reach_all_motors_while_their_time_outs_are_switched_off(held: Held) -> None:
    rig = held.rig
    rig.arm.motors[0].silent = True
    begun = held.tap.waited_s
    with rig.lockstep.serving(), pytest.raises(DriveError, match="joint1"):
        rig.drives.disable_monitoring()
    assert max(longest_gaps(held.tap, begun)) < 0.05  # at 0.1 they let go
    assert [m.registers.number(Register.TIMEOUT) for m in rig.arm.motors[1:]] == [0] * 6


def test_a_minute_off_and_enabled_again(held: Held) -> None:
    rig = held.rig
    rig.request(Event.DISABLE)
    rig.run(1.0)
    assert rig.mode is Mode.OFF
    assert furthest(rig, 60.0).max() < STILL
    assert rig.ask(Event.ENABLE) == []
    assert furthest(rig, 1.0).max() < STILL
    assert all(powered(rig))
