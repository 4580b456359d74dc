"""A drive on its own: NMT, heartbeats both ways, 6007 and 1029, quick stop, faults, limits."""

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from simulator.description import ArmDescription
from simulator.nmt import Nmt
from simulator.state_machine import State

Make = Callable[..., Any]
MOVING = np.array([0.4, 0.2, 0.5, -0.3, 0.3, 0.2, 0.4])


def moving(master: Make, **set_up: int) -> Any:
    """An arm in operation enabled, and at speed."""
    one = master()
    one.set_up(**set_up)
    for word in (0x06, 0x07, 0x0F, 0x0F):
        one.tick(word)
    for _ in range(30):
        one.tick(0x0F, MOVING)
    return one


def emergencies(one: Any, since: int = 0) -> list[tuple[int, int]]:
    """(node, code) of all EMCY frames."""
    return [
        (f.arbitration_id - 0x80, int.from_bytes(f.data[:2], "little"))
        for f in one.frames[since:]
        if 0x80 < f.arbitration_id < 0x100
    ]


def test_boot_up_messages(one: Any) -> None:
    assert [(f.arbitration_id, bytes(f.data)) for f in one.frames] == [
        (0x700 + n, b"\0") for n in range(1, 8)
    ]
    assert one.send(0, b"\x82\x03") == [(0x703, b"\0")]


@pytest.mark.parametrize(
    ("command", "nmt"), [(1, Nmt.OPERATIONAL), (2, Nmt.STOPPED), (128, Nmt.PRE_OPERATIONAL)]
)
def test_nmt_of_one_node_and_of_all(one: Any, command: int, nmt: Nmt) -> None:
    one.send(0, bytes([command, 4]))
    assert [d.nmt is nmt for d in one.arm.drives] == [
        d.node == 4 or nmt is Nmt.PRE_OPERATIONAL for d in one.arm.drives
    ]
    one.send(0, bytes([command, 0]))
    assert all(d.nmt is nmt for d in one.arm.drives)


def test_no_sdo_when_stopped_and_no_pdo_when_not_operational(one: Any) -> None:
    one.set_up()
    one.send(0, b"\x80\x00")
    assert one.tick() == {}
    one.send(0, b"\x02\x00")
    assert one.send(0x601, struct.pack("<BHBI", 0x40, 0x1000, 0, 0)) == []


def test_reset_node_forgets_reset_communication_forgets_the_bus_part(one: Any) -> None:
    one.set_up()
    one.send(0, b"\x82\x01")
    assert one.read(1, 0x1400, 1, "I") == 0x201
    assert one.read(1, 0x6007, 0, "h") == 3
    one.send(0, b"\x81\x01")
    assert one.read(1, 0x6007, 0, "h") == 0
    assert one.read(1, 0x1018, 4, "I") == 1


def test_heartbeat_in_simulated_time(one: Any) -> None:
    one.write(2, 0x1017, 0, "H", 50)
    before = len(one.frames)
    one.arm.advance(1.0)
    beats = [bytes(f.data) for f in one.frames[before:] if f.arbitration_id == 0x702]
    assert len(beats) in (20, 21)
    assert set(beats) == {b"\x7f"}


@pytest.mark.parametrize(
    ("loss", "state", "energised"),
    [
        (0, State.OPERATION_ENABLED, True),
        (1, State.FAULT, False),
        (2, State.SWITCH_ON_DISABLED, False),
        (3, State.QUICK_STOP_ACTIVE, True),
    ],
)
def test_lost_master(master: Make, loss: int, state: State, energised: bool) -> None:
    one = moving(master, loss=loss)
    before = len(one.frames)
    one.wait(0.09)
    assert emergencies(one, before) == []
    one.wait(1.0)
    assert emergencies(one, before) == [(n, 0x8130) for n in range(1, 8)]
    assert {d.state for d in one.arm.drives} == {state}
    assert {d.nmt for d in one.arm.drives} == {Nmt.PRE_OPERATIONAL}
    assert one.read(3, 0x1003, 1, "I") == 0x8130
    assert one.read(3, 0x603F, 0, "H") == 0x8130
    assert one.read(3, 0x1001, 0, "B") == 0x11
    assert [one.arm.servo.energised(j) for j in range(7)] == [energised] * 7
    words = [
        e.text for e in one.events if e.text.startswith("node 3: heartbeat of the master lost")
    ]
    assert len(words) == 1


@pytest.mark.parametrize(
    ("index", "code", "value", "nmt", "state"),
    [
        (0x1016, "I", 0, Nmt.OPERATIONAL, State.OPERATION_ENABLED),  # no heartbeat is consumed
        (0x1029, "B", 0, Nmt.PRE_OPERATIONAL, State.QUICK_STOP_ACTIVE),
        (0x1029, "B", 1, Nmt.OPERATIONAL, State.QUICK_STOP_ACTIVE),
        (0x1029, "B", 2, Nmt.STOPPED, State.QUICK_STOP_ACTIVE),
    ],
)
def test_1016_and_1029_choose_the_reaction_to_a_lost_master(
    master: Make, index: int, code: str, value: int, nmt: Nmt, state: State
) -> None:
    one = moving(master)
    for node in range(1, 8):
        one.write(node, index, 1, code, value)
    one.wait(0.5)
    assert {(d.nmt, d.state) for d in one.arm.drives} == {(nmt, state)}


def test_quick_stop_brakes_at_6085_then_holds_against_a_push(master: Make) -> None:
    one = moving(master)
    one.write(1, 0x6085, 0, "I", round(2.0 / one.arm.drives[0].axis.unit))
    one.command(0x02, MOVING)
    one.tick()
    reference = []
    for _ in range(25):
        one.wait(0.01)
        reference.append(one.arm.servo.reference[0])
    slope = np.diff(reference[:15]) / 0.01
    assert slope == pytest.approx(-2.0, rel=1e-3)
    assert one.arm.drives[0].why == "standing, holding"
    one.wait(0.5)
    where = one.arm.plant.theta[0]
    one.arm.external_torque[0] = -3.0
    one.wait(1.0)
    assert one.arm.plant.theta[0] == pytest.approx(where, abs=0.03)
    assert abs(one.arm.plant.theta_dot[0]) < 0.01
    assert one.arm.drives[0].state is State.QUICK_STOP_ACTIVE
    one.send(0, b"\x01\x00")  # the heartbeat was lost in between
    one.tick(0x0F)
    one.tick(0x0F)
    assert one.arm.drives[0].state is State.OPERATION_ENABLED


def test_quick_stop_option_2_ends_limp(master: Make) -> None:
    one = moving(master, quick_stop=2)
    one.command(0x02)
    one.tick()
    assert one.arm.drives[0].state is State.QUICK_STOP_ACTIVE
    one.wait(0.5)
    assert {d.state for d in one.arm.drives} == {State.SWITCH_ON_DISABLED}
    assert not one.arm.servo.current.any()


@pytest.mark.parametrize(("option", "at_once"), [(0, True), (2, False)])
def test_fault_reaction(master: Make, option: int, at_once: bool) -> None:
    one = moving(master, fault=option)
    drive = one.arm.drives[2]
    before = len(one.frames)
    drive.fault(0x2310, "over-current")
    assert emergencies(one, before) == [(3, 0x2310)]
    one.wait(0.002)
    assert drive.state is (State.FAULT if at_once else State.FAULT_REACTION_ACTIVE)
    one.wait(0.08)
    assert drive.state is State.FAULT
    assert not one.arm.servo.energised(2)
    assert one.arm.servo.energised(1)
    for word in (0x00, 0x80, 0x80):
        one.tick(word)
    assert drive.state is State.SWITCH_ON_DISABLED
    assert emergencies(one)[-1] == (3, 0)
    assert one.read(3, 0x603F, 0, "H") == 0
    assert one.arm.drives[1].state is not State.FAULT


def test_recovery_after_a_lost_master_by_fault_reset(master: Make) -> None:
    one = moving(master, loss=1)
    one.wait(0.5)
    one.send(0, b"\x01\x00")
    for word in (0x00, 0x80, 0x06, 0x07, 0x0F, 0x0F):
        one.tick(word)
    assert {d.state for d in one.arm.drives} == {State.OPERATION_ENABLED}


def test_returning_heartbeat_clears_the_error(master: Make) -> None:
    one = moving(master)
    one.wait(0.3)
    assert one.send(0x77F, b"\x05") == [(0x80 + n, bytes(8)) for n in range(1, 8)]


def test_nmt_stop_is_a_lost_connection_too(master: Make) -> None:
    one = moving(master)
    one.send(0, b"\x02\x00")
    assert {d.state for d in one.arm.drives} == {State.QUICK_STOP_ACTIVE}


def test_velocity_follows_the_interpolated_setpoint(one: Any) -> None:
    one.enable()
    for _ in range(50):
        one.tick(0x0F, 0.0)
    one.tick(0x0F, 0.3)
    one.tick(0x0F, 0.3)  # latched at this SYNC
    references = []
    for _ in range(10):
        references.append(float(one.arm.servo.reference[0]))
        one.wait(0.001)
    assert np.diff(references) == pytest.approx(0.03, rel=1e-3)
    for _ in range(60):
        answers = one.tick(0x0F, 0.3)
    for drive in one.arm.drives:
        word, _, counts = struct.unpack("<Hhi", answers[0x180 + drive.node])
        assert word & 0x6F == 0x27
        assert counts * drive.axis.unit == pytest.approx(0.3, abs=0.03)


def test_a_drive_holds_gravity_without_oscillation(one: Any) -> None:
    one.enable()
    for _ in range(200):
        one.tick(0x0F, 0.0)
    speeds = []
    for _ in range(50):
        one.tick(0x0F, 0.0)
        speeds.append(np.abs(one.arm.plant.theta_dot))
    assert np.max(speeds) < 0.005
    assert np.abs(one.arm.plant.q - one.arm.plant.parameters.initial_position).max() < 0.06


def test_current_limit_and_its_bit(one: Any) -> None:
    one.enable()
    one.write(1, 0x6073, 0, "H", 100)
    answers = {}
    for _ in range(30):
        answers = one.tick(0x0F, 1.0)
    word, current, _ = struct.unpack("<Hhi", answers[0x181])
    assert word & 1 << 11
    assert abs(current) == pytest.approx(100, abs=10)
    assert abs(one.arm.servo.current[0]) <= 0.1 * 2.0 + 1e-12


def test_speed_limit_of_6080(one: Any) -> None:
    one.enable()
    one.write(1, 0x6080, 0, "I", 100)
    one.tick(0x0F, 5.0)
    one.tick(0x0F, 5.0)
    assert one.arm.servo.target[0] == pytest.approx(100 * 2 * np.pi / 60 / 150)


def test_without_mode_9_nothing_moves(one: Any) -> None:
    one.set_up()
    for node in range(1, 8):
        one.write(node, 0x6060, 0, "b", 0)
    for word in (0x06, 0x07, 0x0F, 0x0F, 0x0F):
        answers = one.tick(word, 0.5)
    one.wait(0.09)
    assert not one.arm.servo.reference.any()
    assert struct.unpack_from("<H", answers[0x181])[0] & 1 << 12 == 0


def test_limp_unless_enabled_but_a_brake_holds(master: Make, romeo: ArmDescription) -> None:
    joints = (replace(romeo.joints[0], brake=True), *romeo.joints[1:])
    limp, braked = master(), master(replace(romeo, joints=joints))
    for one in (limp, braked):
        one.arm.advance(1.0)
        assert not one.arm.servo.current.any()
    assert abs(limp.arm.plant.theta[0]) > 0.2
    assert abs(braked.arm.plant.theta[0]) < 1e-9
    braked.enable()
    for _ in range(30):
        braked.tick(0x0F, 0.3)
    assert braked.arm.plant.theta[0] > 0.05
