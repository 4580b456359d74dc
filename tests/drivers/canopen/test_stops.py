"""Stops of the whole arm, on the wire: which frames go out, and in which tick."""

import errno
import struct

import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO, lockstep_rig
from daemon.modes.table import Event, Mode
from drivers.api import Kind, PowerTarget
from drivers.canopen.drives import CanopenDrives
from drivers.canopen.events import Fact
from drivers.stopping.watches import REPEATS
from tests.drivers.canopen.scripted_wire import (
    PERIOD_S,
    N,
    ScriptedWire,
    crossed,
    everything,
    frame,
    restarted,
    tick,
)

STILL = np.zeros(N)
STOPS, RUNS = 0x07, 0x27
NMT, SYNC, HEARTBEAT = 0x000, 0x080, 0x77F
STOP_BY_SDO = bytes.fromhex("2b40600002000000")
COMMANDED = bytes.fromhex("6040600000000000")
STOP, OFF, ON = PowerTarget.QUICK_STOP, PowerTarget.OFF, PowerTarget.ON
ALL = range(1, N + 1)


def standing(*but: int, statusword: int = STOPS) -> list:
    """Answers to SYNC of drives that stand; those of `but` are silent."""
    word = struct.pack("<Hhi", statusword, 0, 0)
    pairs = [(frame(0x180 + n, word), frame(0x280 + n, bytes(8))) for n in ALL if n not in but]
    return [each for pair in pairs for each in pair]


def beats() -> list:
    return [frame(0x700 + node, b"\x05") for node in ALL]


def answers(data: bytes, *nodes: int) -> list:
    """The same answer of the SDO servers of these nodes."""
    return [frame(0x580 + node, data) for node in nodes]


class Arm:
    """Ticks one after the other, and what goes out in each."""

    def __init__(self, drives: CanopenDrives, wire: ScriptedWire) -> None:
        self.drives, self.wire, self.ticks = drives, wire, 0

    def tick(self, frames: list, target: PowerTarget = STOP, after: int = 1) -> tuple:
        """One tick, `after` so many periods; returns frames sent and events."""
        self.ticks += after
        self.wire.sent.clear()
        samples = tick(self.drives, self.wire, beats() + frames, self.ticks * PERIOD_S)
        self.drives.command(target, STILL)
        return list(self.wire.sent), samples.events

    def sdo(self, sent: list) -> list:
        """Nodes and data of the SDO requests among frames."""
        return [(cob_id - 0x600, data) for cob_id, data in sent if cob_id >> 7 == 0x600 >> 7]


@pytest.fixture
def arm(drives: CanopenDrives, scripted: ScriptedWire) -> Arm:
    made = Arm(drives, scripted)
    made.tick(everything(), ON)
    return made


@pytest.fixture
def rested(arm: Arm) -> Arm:
    """It has stood in operation for a while."""
    for _ in range(25):
        arm.tick(standing(statusword=RUNS), ON)
    return arm


def test_a_drive_that_reports_a_stop_is_commanded_by_its_setpoint_alone(rested: Arm) -> None:
    arm = rested
    sent, _ = arm.tick(standing(statusword=RUNS))
    assert arm.drives.unproved() == arm.drives.names
    assert arm.sdo(sent) == []
    for _ in range(2):
        assert arm.drives.unproved() == arm.drives.names
        sent, events = arm.tick(standing())
        assert (arm.sdo(sent), events) == ([], ())
    assert arm.drives.unproved() == ()


def test_a_velocity_that_was_never_seen_to_move_needs_positions_that_rest(arm: Arm) -> None:
    arm.tick(everything())
    for k in range(22):
        assert arm.drives.unproved() == arm.drives.names, k
        arm.tick(standing())
    assert arm.drives.unproved() == (), "0.2 s, and once more"


def test_a_drive_without_a_sample_is_commanded_by_sdo_in_the_same_tick(rested: Arm) -> None:
    """It is asked for its statusword, velocity, and positions in turn; all must say that it
    stands."""
    arm = rested
    sent, _ = arm.tick(standing(3))
    assert arm.sdo(sent) == [(3, STOP_BY_SDO)]
    asked: list[bytes] = []
    answer = COMMANDED
    while arm.drives.unproved():
        sent, _ = arm.tick(standing(3) + answers(answer, 3))
        commanded = arm.sdo(sent)
        assert [node for node, _ in commanded] == [3] * len(commanded)
        asked += [data[1:4] for _, data in commanded]
        values = {0x41: b"\x4b\x41\x60\0\x07\x02\0\0"}
        answer = values.get(asked[-1][0], b"\x43" + asked[-1] + bytes(4))
    word, velocity = b"\x41\x60\0", b"\x6c\x60\0"
    link, motor = b"\xe4\x60\x01", b"\x64\x60\0"
    cycle = [word, velocity, link, word, velocity, motor]
    *asked, command = asked  # a proof needs new readings, from the command on
    assert command == b"\x40\x60\0"
    assert asked == [*cycle, *cycle, word][: len(asked)]
    assert asked.count(velocity) == 4, "twice after both positions were read"
    assert not arm.drives.silenced


def test_the_stages_of_a_drive_that_stays_in_operation(rested: Arm) -> None:
    """It stands still in operation, so that its travel lasts: three, six and nine ticks."""
    arm = rested
    on = [frame(0x183, struct.pack("<Hhi", RUNS, 0, 0)), frame(0x283, bytes(8))]
    by_tick, events = {}, {}
    for k in range(25):
        sent, happened = arm.tick(standing(3) + on)
        for cob_id, data in sent:
            if cob_id == NMT or (cob_id, data) == (0x603, STOP_BY_SDO):
                by_tick.setdefault(k, []).append((cob_id, data[0] if cob_id == NMT else "stop"))
        events |= {k: happened} if happened else {}
        if arm.drives.silenced:
            break
    assert by_tick[3] == [(0x603, "stop")]
    assert by_tick[9] == [(NMT, 2)]
    assert by_tick[10][0] == (NMT, 128), "stopped, it would answer no SDO"
    assert k == 18
    assert events == {10: crossed(Fact(Kind.NOT_SEEN_TO_STOP, (3,), "NMT stop sent"))}
    sent, happened = arm.tick([])
    assert happened == crossed(Fact(Kind.UNPROVED, (3,), "our heartbeat is ended"))
    silence = [arm.tick(beats())[0] for _ in range(20)]
    assert {cob_id for sent in silence for cob_id, _ in sent} == {0x600 + n for n in ALL}, (
        "questions, nothing else"
    )
    assert arm.drives.unfit() == [*range(N)], "all have missed us"


def test_a_drive_that_never_answered_is_assumed_at_full_speed(
    drives: CanopenDrives, scripted: ScriptedWire
) -> None:
    """Its silence comes as early as that of one that was seen to."""
    arm = Arm(drives, scripted)
    while not drives.silenced:
        arm.tick(standing(3))
    assert arm.ticks <= 3 * 3 + 2, "at full speed each stage has three ticks, at rest six and nine"


def test_a_drive_that_restarted_is_commanded_by_sdo_alone(arm: Arm) -> None:
    sent, events = arm.tick([frame(0x703, b"\0"), *everything()])
    assert set(crossed(restarted(3))) <= set(events)
    assert (3, STOP_BY_SDO) in arm.sdo(sent)


def test_a_drive_that_need_not_stop_is_not_commanded(arm: Arm) -> None:
    for _ in range(30):
        sent, events = arm.tick(everything()[:8], ON)
        assert (arm.sdo(sent), events) == ([], ())
    assert arm.drives.unproved() == ()


@pytest.mark.parametrize("gap", [9, 10, 30, 300])
def test_after_a_gap_in_our_presence_no_sync_goes_out_before_all_have_confirmed(
    arm: Arm, gap: int
) -> None:
    sent, events = arm.tick([], ON, after=gap)  # a tick ago, it was a tick since our heartbeat
    assert events[0].kind is Kind.ABSENT
    assert events[0].text.endswith(f" for {(gap + 1) * 10} ms")
    order = [cob_id for cob_id, _ in sent]
    assert order[: 2 * N] == [*(0x200 + n for n in ALL), *(0x600 + n for n in ALL)]
    assert {data for cob_id, data in sent if cob_id >> 7 == 4} == {bytes([2, 0, 0, 0, 0, 0])}
    assert SYNC not in order
    sent, _ = arm.tick(answers(COMMANDED, *range(1, N)), ON)
    assert SYNC not in [cob_id for cob_id, _ in sent], "one has not confirmed"
    assert {data[:2] for cob_id, data in sent if cob_id >> 7 == 4} == {b"\x02\0"}
    sent, _ = arm.tick(answers(COMMANDED, N), ON)
    sent, _ = arm.tick(standing())
    assert (SYNC, b"") in sent


def test_a_gap_shorter_than_the_drives_timeout_is_none(arm: Arm) -> None:
    sent, events = arm.tick(everything(), ON, after=8)
    assert events == ()
    assert (SYNC, b"") in sent


def test_after_bus_off_no_sync_goes_out(arm: Arm) -> None:
    sent, events = arm.tick([frame(0x040, bytes(8), is_error_frame=True), *everything()])
    assert events == crossed(Fact(Kind.OFF_BUS))
    sent, _ = arm.tick([])
    assert SYNC not in [cob_id for cob_id, _ in sent], "it would be queued behind an old setpoint"


def test_heartbeats_that_failed_count_as_a_gap(arm: Arm, scripted: ScriptedWire) -> None:
    scripted.failure = OSError(errno.ENOBUFS, "No buffer space available")
    found = []
    for _ in range(12):
        arm.ticks += 1
        arm.drives.sync(arm.ticks * PERIOD_S)
        found += arm.drives.collect(0.0).events
        arm.drives.command(ON, STILL)
    assert {event.kind for event in found} == {Kind.DISTURBED, Kind.ABSENT}
    scripted.failure = None
    sent, _ = arm.tick([], ON)
    assert SYNC not in [cob_id for cob_id, _ in sent]


def test_a_start_ends_the_silence(arm: Arm) -> None:
    for _ in range(40):
        arm.tick([])
    assert arm.drives.silenced
    arm.drives.start(arm.ticks * PERIOD_S)
    assert not arm.drives.silenced
    for _ in range(23):
        sent, _ = arm.tick(standing(), OFF)
        assert (SYNC, b"") in sent
    assert arm.drives.unproved() == ()


def test_tpdos_without_a_sync_are_no_answers(arm: Arm) -> None:
    arm.tick([], ON, after=30)
    arm.tick(everything(), ON)
    assert not arm.drives.samples.fresh.any()


def moving(k: int, counts: int = 3000, statusword: int = RUNS) -> list:
    """Answers to SYNC in tick k: joint 3 moves, or says so, as its velocity (0.1 rpm) says."""
    word = struct.pack("<Hhi", statusword, 100, counts)
    return [*standing(3), frame(0x183, word), frame(0x283, struct.pack("<ii", 90 * k, 90 * k))]


def test_samples_that_repeat_while_the_motor_moves_are_reported_and_it_is_asked(arm: Arm) -> None:
    for k in range(5):
        assert arm.tick(moving(k), ON)[1] == ()
    found = {k: events for k in range(20) if (events := arm.tick(moving(4), ON)[1])}
    assert found == {10: crossed(Fact(Kind.REPEATED_SAMPLES, (3,), REPEATS))}, (
        "0.1 s after the last that did not, and once"
    )
    commanded = []
    for k in range(40):
        commanded += arm.sdo(arm.tick(moving(4, statusword=STOPS))[0])
        assert "LElbowRoll" in arm.drives.unproved(), k
    assert commanded[0] == (3, STOP_BY_SDO), "its samples are no witness"
    assert not arm.drives.silenced, "its statusword says that it obeys"


def test_a_drive_that_moves_gets_a_ramp_before_its_power_is_taken(arm: Arm) -> None:
    """Only what was seen to stand is without power."""
    words = []
    for k in range(30):
        sent, _ = arm.tick(moving(min(k, 9), max(3000 - 360 * k, 0), STOPS if k else RUNS), OFF)
        words += [data[0] for cob_id, data in sent if cob_id == 0x203]
    assert words[:10] == [2] * 10
    assert words[-1] == 0
    assert words == sorted(words, reverse=True), "and not again"


@pytest.mark.parametrize("push", [2.0, 5.0])
def test_a_hand_that_pushes_what_its_drives_hold_is_no_fault(push: float) -> None:
    """Half a second on an elbow that is held in quick stop: it gives way, and swings back."""
    with lockstep_rig(ROMEO) as rig:
        rig.enable()
        rig.run(0.5)
        rig.request(Event.DISABLE)
        rig.run(1.0)
        rig.arm.external_torque[2] = push
        rig.run(0.5)
        rig.arm.external_torque[2] = 0.0
        rig.run(1.5)
        assert rig.mode is Mode.OFF
        assert rig.last.unproved == ()


@pytest.mark.parametrize(("out_s", "back_s"), [(0.3, 2.0), (0.8, 0.5)])
def test_a_push_beyond_the_travel_does_not_cut_the_power(out_s: float, back_s: float) -> None:
    """A spring of 60 Nm/rad, 0.9 rad out and back: the drive gives all it can, and springs back."""
    with lockstep_rig(ROMEO) as rig:
        rig.enable()
        rig.tick.controller.apply_event(Event.FAULT, "the test", rig.time_s)
        rig.run(1.0)
        assert rig.last.unproved == ()
        begin_s, begin, most = rig.time_s, rig.arm.plant.q[0], 0.0
        while (t := rig.time_s - begin_s) < out_s + back_s:
            gone = rig.arm.plant.q[0] - begin
            hand = 0.9 * min(t / out_s, 1.0, (out_s + back_s - t) / back_s)
            rig.arm.external_torque[0] = 60.0 * (hand - gone)
            rig.step()
            most = max(most, abs(gone))
        assert most > 0.5, "of the 0.24 rad of its travel"
        assert rig.arm.servo.energised(0)
