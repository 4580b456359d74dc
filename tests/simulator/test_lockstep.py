"""The arm on a virtual bus: the SYNC is the clock, equal seeds give equal bits."""

import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import can
import numpy as np
import pytest

from bench.rigs.sync_clock import Lockstep
from simulator.arm import SimulatedArm
from simulator.description import ArmDescription, SimulationSettings
from simulator.hand_script import Push


@contextmanager
def both_ends(
    description: ArmDescription, **settings: Any
) -> Iterator[tuple[Lockstep, can.BusABC, SimulatedArm]]:
    channel = object()
    with (
        can.Bus(interface="virtual", channel=channel) as ours,
        can.Bus(interface="virtual", channel=channel) as theirs,
    ):
        script = [Push(at_s=0.1, joint="LElbowRoll", torque=1.0, duration_s=0.2)]
        arm = SimulatedArm(
            description, SimulationSettings(**settings), theirs.send, hand_script=script
        )
        arm.power_on()
        yield Lockstep(arm, theirs), ours, arm


def write(lockstep: Lockstep, bus: can.BusABC, request: bytes, node: int) -> bytes:
    bus.send(can.Message(arbitration_id=0x600 + node, data=request, is_extended_id=False))
    lockstep.pump()
    answer = b""
    while (message := bus.recv(0.0)) is not None:
        answer = bytes(message.data)
    return answer


def run(description: ArmDescription, ticks: int, **settings: Any) -> tuple[list[bytes], Any]:
    """Enable with the default RPDO4 (controlword, target velocity), then move; frames and truth."""
    frames: list[bytes] = []
    with both_ends(description, **settings) as (lockstep, bus, arm):
        for node in range(1, 8):
            mode = struct.pack("<BHBI", 0x2F, 0x6060, 0, 9)
            assert write(lockstep, bus, mode, node)[0] == 0x60
        bus.send(can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False))
        for k in range(ticks):
            bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
            lockstep.pump()
            while (message := bus.recv(0.0)) is not None:
                frames.append(struct.pack("<I", message.arbitration_id) + bytes(message.data))
            word = (0x06, 0x07, 0x0F)[min(k, 2)]
            for node in range(1, 8):
                data = struct.pack("<Hi", word, round(1000 * np.sin(0.05 * k)))
                bus.send(can.Message(arbitration_id=0x500 + node, data=data, is_extended_id=False))
        assert lockstep.syncs == ticks
        assert arm.now == pytest.approx(0.01 * ticks)
        truth = np.concatenate((arm.plant.q, arm.plant.theta, arm.plant.q_dot))
    return frames, truth.tobytes()


@pytest.mark.parametrize("friction", ["smooth", "dahl"])
def test_same_seed_same_bits(romeo: ArmDescription, friction: str) -> None:
    first = run(romeo, 60, seed=3, friction=friction)
    assert len(first[0]) > 60 * 14
    assert first == run(romeo, 60, seed=3, friction=friction)
    assert first != run(romeo, 60, seed=4, friction=friction)


def test_time_stands_still_without_sync(romeo: ArmDescription) -> None:
    with both_ends(romeo) as (lockstep, bus, arm):
        bus.send(can.Message(arbitration_id=0x77F, data=[5], is_extended_id=False))
        assert lockstep.pump() == 1
        assert lockstep.pump() == 0
        assert arm.now == 0.0


def test_serving_answers_from_a_thread_and_ends(romeo: ArmDescription) -> None:
    with both_ends(romeo) as (lockstep, bus, arm):
        while bus.recv(0.0) is not None:
            pass
        request = struct.pack("<BHBI", 0x40, 0x1000, 0, 0)
        with lockstep.serving():
            bus.send(can.Message(arbitration_id=0x601, data=request, is_extended_id=False))
            answer = bus.recv(5.0)
        assert answer is not None
        assert struct.unpack_from("<I", answer.data, 4) == (0x00020192,)
        bus.send(can.Message(arbitration_id=0x601, data=request, is_extended_id=False))
        assert bus.recv(0.05) is None
        assert arm.now == 0.0


def test_external_torque_moves_the_limp_arm(romeo: ArmDescription) -> None:
    ends = []
    for torque in (-1.0, 1.0):
        with both_ends(romeo) as (lockstep, bus, arm):
            arm.external_torque[2] = torque
            for _ in range(20):
                bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
                lockstep.pump()
            assert arm.tau_ext[2] == torque
            ends.append(float(arm.plant.q[2]))
    assert ends[0] < -0.01
    assert ends[1] > 0.01


def test_speed_is_reported(master: Callable[..., Any], capsys: pytest.CaptureFixture[str]) -> None:
    """A figure for people; a limit would fail on a busy machine and say nothing."""
    one = master()
    one.enable()
    start = time.process_time()
    for _ in range(100):
        one.tick(0x0F, 0.1)
    each = (time.process_time() - start) / 100
    assert one.arm.now > 1.0
    with capsys.disabled():
        print(f"\nplant, drives and frames: {1e3 * each:.2f} ms of CPU per tick of 10 ms")
