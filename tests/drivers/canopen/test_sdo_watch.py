"""Drives that answer no SDO, asked one after the other while the arm stands."""

import struct

import pytest

from drivers.canopen.sdo_watch import ROUND_EVERY_S, SdoWatch

PERIOD_S = 0.01
TIMEOUT_S = 0.15  # 0.3 of 500 ms


def answer(command: int = 0x4F, index: int = 0x1001) -> bytes:
    return struct.pack("<BHBI", command, index, 0, 0)


class Bus:
    """Drives that answer one tick after they were asked, but for those in `silent`."""

    def __init__(self, drives) -> None:
        self.watch, self.silent, self.asked = SdoWatch(drives), set(), []
        self.now, self._answering = 0.0, []

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            for node in self._answering:
                self.watch.on_sdo(node, answer())
            frames = self.watch.ask(self.now)
            assert len(frames) <= 1
            self.asked += [(round(self.now, 2), can_id - 0x600) for can_id, _ in frames]
            self._answering = [
                can_id - 0x600 for can_id, _ in frames if can_id - 0x600 not in self.silent
            ]
            self.now += PERIOD_S


@pytest.fixture
def bus(joint_drives) -> Bus:
    return Bus(joint_drives)


def test_all_are_asked_in_a_round_and_then_only_now_and_then(bus) -> None:
    bus.run(1.0)
    assert [node for _, node in bus.asked] == [1, 2, 3, 4, 5, 6, 7]
    assert bus.asked[-1][0] == pytest.approx(6 * PERIOD_S)
    bus.run(ROUND_EVERY_S)
    assert len(bus.asked) == 14
    assert bus.watch.silent == []


def test_one_that_does_not_answer_is_found_and_the_others_are_asked_on(bus) -> None:
    bus.silent = {3}
    bus.run(2 * TIMEOUT_S + 0.15)
    assert bus.watch.silent == [2]
    assert [node for _, node in bus.asked] == [1, 2, 3, 3, 4, 5, 6, 7]
    bus.silent = set()
    bus.run(ROUND_EVERY_S + 0.2)
    assert bus.watch.silent == []


def test_one_lost_answer_is_none(bus) -> None:
    bus.silent = {3}
    bus.run(TIMEOUT_S + 0.01)
    bus.silent = set()
    bus.run(1.0)
    assert bus.watch.silent == []


@pytest.mark.parametrize(
    ("data", "counts"),
    [(answer(), True), (answer(0x80), True), (answer(index=0x6041), False), (b"\x4f", False)],
)
def test_what_is_an_answer(bus, data, counts) -> None:
    """A refusal is one; what another client asked for is none."""
    bus.silent = {1}
    bus.run(2 * TIMEOUT_S + 0.03)
    assert bus.watch.silent == [0]
    bus.watch.on_sdo(1, data)
    bus.watch.on_sdo(99, data)
    assert bus.watch.silent == ([] if counts else [0])


def test_what_was_on_its_way_when_the_asking_ended_is_not_held_against_a_drive(bus) -> None:
    bus.silent = {1}
    for _ in range(5):
        bus.run(TIMEOUT_S - 0.02)
        bus.watch.rest()
        bus.now += 1.0
    assert bus.watch.silent == []


def test_who_was_read_by_sdo_answers(bus) -> None:
    bus.silent = {1}
    bus.run(1.0)
    bus.watch.forget()
    assert bus.watch.silent == []
