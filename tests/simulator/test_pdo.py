"""The mapping procedure of CiA 301 and what then goes over the bus."""

import struct
from typing import Any

import pytest

NODE = 2
INVALID = 1 << 31


@pytest.mark.parametrize(("communication", "cob"), [(0x1400, 0x202), (0x1800, 0x40000182)])
def test_a_valid_pdo_cannot_be_mapped(one: Any, communication: int, cob: int) -> None:
    mapped = communication + 0x200
    assert one.write(NODE, mapped, 0, "B", 0) == 0x06010000
    assert one.write(NODE, mapped, 1, "I", 0x60FF0020) == 0x06010000
    assert one.write(NODE, communication, 1, "I", INVALID | cob) == 0
    assert one.write(NODE, mapped, 1, "I", 0x60FF0020) == 0x06010000  # sub 0 is not 0 yet
    assert one.write(NODE, mapped, 0, "B", 0) == 0
    assert one.write(NODE, mapped, 1, "I", 0x60FF0020) == 0
    assert one.write(NODE, mapped, 0, "B", 1) == 0
    assert one.write(NODE, communication, 1, "I", cob) == 0


@pytest.mark.parametrize(
    ("mapped", "entry", "abort"),
    [
        (0x1600, 0x20000010, 0x06020000),
        (0x1600, 0x60070010, 0x06040041),  # exists, but not mappable
        (0x1600, 0x60410010, 0x06040041),  # read-only cannot be received
        (0x1600, 0x60FF0010, 0x06040041),  # wrong length
        (0x1A00, 0x60410010, 0),
        (0x1A00, 0x60E40120, 0),
    ],
)
def test_what_may_be_mapped(one: Any, mapped: int, entry: int, abort: int) -> None:
    one.write(NODE, mapped - 0x200, 1, "I", INVALID | 0x182)
    one.write(NODE, mapped, 0, "B", 0)
    assert one.write(NODE, mapped, 1, "I", entry) == abort


def test_eight_bytes_are_the_limit(one: Any) -> None:
    one.write(NODE, 0x1800, 1, "I", INVALID | 0x182)
    one.write(NODE, 0x1A00, 0, "B", 0)
    for sub, entry in enumerate((0x60640020, 0x606C0020, 0x60410010), start=1):
        assert not one.write(NODE, 0x1A00, sub, "I", entry)
    assert one.write(NODE, 0x1A00, 0, "B", 3) == 0x06040042
    assert one.write(NODE, 0x1A00, 0, "B", 2) == 0
    assert one.write(NODE, 0x1A00, 0, "B", 5) == 0x06090031


@pytest.mark.parametrize(
    ("index", "sub", "code", "value", "abort"),
    [
        (0x1800, 1, "I", 0x40000199, 0x06090030),  # another COB-ID while valid
        (0x1800, 1, "I", INVALID | 0x199, 0),
        (0x1800, 1, "I", INVALID | 1 << 29 | 0x199, 0x06090030),  # 29-bit identifiers
        (0x1800, 2, "B", 241, 0x06090030),
        (0x1800, 2, "B", 240, 0),
        (0x1800, 2, "B", 254, 0),
        (0x1800, 3, "H", 100, 0x06090030),  # inhibit time while valid
    ],
)
def test_communication_parameters(
    one: Any, index: int, sub: int, code: str, value: int, abort: int
) -> None:
    assert one.write(NODE, index, sub, code, value) == abort


def test_defaults_are_not_what_a_csv_master_wants(one: Any) -> None:
    one.send(0, b"\x01\x00")
    one.arm.advance(0.005)
    events = {f.arbitration_id for f in one.frames}
    assert {0x182, 0x282} <= events  # on change, by themselves
    assert {0x380 + NODE, 0x480 + NODE} <= dict(one.send(0x80)).keys()


def test_sync_brings_what_was_mapped(one: Any) -> None:
    one.set_up()
    answers = one.tick()
    assert sorted(answers) == [base + n for base in (0x180, 0x280) for n in range(1, 8)]
    word, current, velocity = struct.unpack("<Hhi", answers[0x182])
    assert word == 0x0250  # switch on disabled, voltage, remote
    assert (abs(current), abs(velocity)) < (50, 200)
    link, motor = struct.unpack("<ii", answers[0x282])
    turn = 6.283185307179586
    assert link == pytest.approx(one.arm.plant.q[1] / turn * 131072, abs=1)
    assert motor == pytest.approx(one.arm.plant.theta[1] / turn * 150 * 4096, abs=1)


@pytest.mark.parametrize("every", [1, 2, 5])
def test_every_nth_sync(one: Any, every: int) -> None:
    one.set_up()
    one.write(NODE, 0x1800, 2, "B", every)
    assert sum(0x182 in one.tick() for _ in range(10)) == 10 // every


def test_event_driven_pdo_reports_a_change_once(one: Any) -> None:
    one.set_up()
    one.write(NODE, 0x1800, 2, "B", 255)
    one.write(NODE, 0x1800, 1, "I", INVALID | 0x182)
    one.write(NODE, 0x1A00, 0, "B", 1)  # statusword alone
    one.write(NODE, 0x1800, 1, "I", 0x182)

    def sent() -> int:
        before = len(one.frames)
        one.arm.advance(one.arm.now + 0.02)
        return sum(f.arbitration_id == 0x182 for f in one.frames[before:])

    assert [sent(), sent()] == [1, 0]
    one.write(NODE, 0x6040, 0, "H", 0x06)
    assert [sent(), sent()] == [1, 0]


def test_rpdo_waits_for_the_sync(one: Any) -> None:
    one.set_up()
    one.command(0x06)
    assert one.arm.drives[1].state.name == "SWITCH_ON_DISABLED"
    one.tick()
    assert one.arm.drives[1].state.name == "READY_TO_SWITCH_ON"


def test_type_255_acts_at_once_and_short_frames_are_an_error(one: Any) -> None:
    one.set_up()
    one.write(NODE, 0x1400, 2, "B", 255)
    answers = one.send(0x202, b"\x06\x00\x00")
    assert answers == [(0x82, bytes.fromhex("1082110000000000"))]
    one.send(0x202, bytes([6, 0, 0, 0, 0, 0]))
    assert one.arm.drives[1].state.name == "READY_TO_SWITCH_ON"


def test_rpdo_out_of_range_is_left_alone(one: Any) -> None:
    one.set_up()
    one.map_pdo(NODE, 0x1401, 0x302, [0x60600008])
    one.send(0x302, b"\x08")
    one.tick()
    assert one.read(NODE, 0x6060, 0, "b") == 9
