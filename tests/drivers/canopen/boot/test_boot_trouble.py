"""Boot-up of drives that do not answer, are in fault, or are set up again."""

import errno
import struct
import time

import can
import pytest

from common.errors import BusError, DriveError
from drivers.can.virtual import QueueWire
from tests.drivers.canopen.boot.changed_setups import third, with_profile, with_wiring


def intercept(drive, hook):
    """Let `hook(index, subindex, writes)` see every SDO request first; True swallows it."""
    answer = drive.on_sdo

    def on_sdo(data):
        index, subindex = struct.unpack_from("<HB", data, 1)
        if not hook(index, subindex, data[0] & 0xE0 == 0x20):
            answer(data)

    drive.on_sdo = on_sdo


def test_a_lost_answer_repeats_one_step(bench, setups):
    lost = iter([True])
    drive, lines = bench.simulated.drives[2], []
    intercept(drive, lambda index, _, writes: index == 0x605A and next(lost, False))
    bench.boot_up(setups[:3], progress=lines.append)
    assert bench.number(2, 0x605A) == 6
    (again,) = [line for line in lines if "repeated" in line]
    assert again.startswith(
        "node 3 (LElbowRoll): step `stopping` was repeated: node 3 (LElbowRoll) does not answer "
        "(SDO timeout 500 ms; object 0x605A:00: writing 6"
    )


def test_a_drive_that_stops_answering_is_named_with_its_step(bench, setups):
    drive, asked = bench.simulated.drives[2], []
    intercept(drive, lambda index, sub, _: index == 0x1A01 and not asked.append(sub))
    says = r"node 3 \(LElbowRoll\) does not answer .* step `PDO mapping`, tried 3 times"
    with pytest.raises(DriveError, match=says):
        bench.boot_up(third(setups))
    assert asked == [0] * 3


@pytest.mark.parametrize("slow", [False, True])
def test_two_drives_that_answer_as_one_node_are_named(bench, setups, slow):
    """The second answers at once, or after the next request."""
    send, late = bench.simulated._send, []

    def twice(message):
        send(message)
        if message.arbitration_id == 0x583:
            late.append(message)
            while len(late) > slow:
                send(late.pop(0))

    bench.simulated._send = twice
    with pytest.raises(DriveError, match=r"two drives answer as node 3 \(LElbowRoll\)"):
        bench.boot_up(third(setups))


def test_answers_to_a_tool_that_polls_the_statusword_are_no_second_drive(bench, setups):
    send = bench.simulated._send

    def polled(message):
        send(message)
        if message.arbitration_id == 0x583 and message.data[1:3] == b"\x41\x60":
            for _ in range(5):
                send(message)

    bench.simulated._send = polled
    assert len(bench.boot_up(setups)) == len(setups)


def test_a_stopped_drive_is_set_up(bench, setups):
    bench.simulated.drives[2].on_nmt(2)
    assert bench.boot_up(setups)[2].serial == 3


def test_an_operational_drive_is_set_up(bench, setups):
    bench.boot_up(setups)
    for drive in bench.simulated.drives:
        drive.on_nmt(1)
    bench.boot_up(setups)
    assert {drive.nmt.name for drive in bench.simulated.drives} == {"PRE_OPERATIONAL"}


def test_a_drive_in_fault_gets_its_communication_reset(bench, setups):
    drive = bench.simulated.drives[2]
    drive.fault(0x2310, "too much current")
    drive.tick(0.0)
    assert drive.state.name == "FAULT"
    lines, commands = [], []
    on_nmt = drive.on_nmt
    drive.on_nmt = lambda command: (commands.append(command), on_nmt(command))
    bench.boot_up(setups, progress=lines.append)
    assert commands == [130, 128], "reset communication, then pre-operational"
    assert "node 3 (LElbowRoll): was in fault (0x2310): communication was reset" in lines
    assert bench.number(2, 0x6007) == 3
    assert drive.state.name == "FAULT", "only a person resets the fault"


def test_a_drive_in_fault_that_does_not_boot_is_reported(bench, setups):
    drive = bench.simulated.drives[2]
    drive.fault(0x2310, "too much current")
    drive.tick(0.0)
    drive.on_nmt = lambda command: None
    with pytest.raises(DriveError, match=r"no boot-up message after NMT reset communication"):
        bench.boot_up(third(setups))


@pytest.mark.parametrize(("bears_ms", "beats"), [(100, 10), (30, 30)])
def test_the_other_drives_get_heartbeats_while_one_is_set_up_again(bench, setups, bears_ms, beats):
    bench.boot_up(setups)
    drive = bench.simulated.drives[2]
    drive.on_nmt(129)
    assert bench.number(2, 0x6007) == 0
    heard, called = [], []
    other = bench.simulated.drives[0]
    other.on_heartbeat = lambda node, now: heard.append(node)
    # The first request is lost: its time-out alone is longer than the others bear.
    lost = iter([True])
    intercept(drive, lambda *_: next(lost, False))
    renewed = with_profile(setups[2], sdo_timeout_ms=500)
    others = [with_profile(setup, master_timeout_ms=bears_ms) for setup in setups]
    begun = time.monotonic()
    with bench.lockstep.serving():
        bench.boot(third(others, renewed)).renew([2], lambda: called.append(None))
    took = time.monotonic() - begun
    assert bench.number(2, 0x6007) == 3
    assert took > 2 * 0.3 * 0.5, "the time-out, and the wait for a late answer"
    assert len(heard) >= beats, "as often as the shortest timeout of all drives needs it"
    assert set(heard) == {127}
    assert len(called) == len(heard)


def test_a_bus_that_fails_while_a_drive_is_waited_for_is_reported(bench, setups, monkeypatch):
    bench.boot_up(setups)
    drive = bench.simulated.drives[2]
    intercept(drive, lambda *_: True)  # silent
    send, beats = QueueWire.send, []

    def failing(wire, frames):
        if frames[0][0] == 0x77F:
            beats.append(frames)
            if len(beats) > 2:
                raise can.CanOperationError("Network is down", errno.ENETDOWN)
        return send(wire, frames)

    monkeypatch.setattr(QueueWire, "send", failing)
    silent = with_profile(setups[2], sdo_timeout_ms=500)
    with bench.lockstep.serving(), pytest.raises(BusError, match="heartbeat: Network is down"):
        bench.boot(third(setups, silent)).renew([2])


def test_drives_in_fault_boot_side_by_side(bench, setups):
    """Each takes a while to boot; together they take no longer."""
    commands = []
    for drive in bench.simulated.drives:
        drive.fault(0x2310, "too much current")
        drive.tick(0.0)

        def hear(command, node=drive.node, on_nmt=drive.on_nmt):
            commands.append((command, node))
            if command != 130:
                on_nmt(command)
            elif node == len(setups):  # by now all of them are to boot
                for other in bench.simulated.drives:
                    other.boot()

        drive.on_nmt = hear
    bench.boot_up(setups)
    nodes = range(1, len(setups) + 1)
    assert commands == [(130, node) for node in nodes] + [(128, node) for node in nodes]


def test_monitoring_is_disabled_at_every_drive_even_if_one_is_gone(bench, setups):
    bench.boot_up(setups)
    gone = with_profile(with_wiring(setups[2], node=99), sdo_timeout_ms=100)
    with bench.lockstep.serving(), pytest.raises(DriveError, match="node 99"):
        bench.boot(third(setups, gone)).disable_monitoring()
    watched = [bench.number(drive, 0x1016, 1) for drive in range(7)]
    assert watched == [0, 0, 127 << 16 | 100, 0, 0, 0, 0]


def test_a_drive_that_restarts_while_it_is_set_up_is_reported(bench, setups):
    drive, booted = bench.simulated.drives[2], iter([True])

    def restart(index, _, writes):
        if index == 0x605A and writes and next(booted, False):
            bench.other_end.send(can.Message(arbitration_id=0x703, data=[0], is_extended_id=False))

    intercept(drive, restart)
    with pytest.raises(DriveError, match=r"\(LElbowRoll\) restarted while the drives were set up"):
        bench.boot_up(setups)
