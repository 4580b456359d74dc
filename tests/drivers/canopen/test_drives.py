"""The arm on a bus: ticks with the simulated drives, and with everything that may go wrong."""

import errno
import struct
from copy import deepcopy
from dataclasses import fields

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.api import DriveCondition, Kind, PowerTarget
from drivers.can.virtual import QueueWire
from drivers.canopen.drives import CanopenDrives
from drivers.canopen.events import Emergency, Fact
from drivers.canopen.inbox import FRAMES_PER_PASS
from drivers.event_queue import EVENTS_PER_TICK
from tests.drivers.canopen.scripted_wire import (
    PERIOD_S,
    N,
    ScriptedWire,
    crossed,
    dropped,
    everything,
    frame,
    restarted,
    tick,
)
from tests.examples import scaled

STILL = np.zeros(N)
PASSIVE = Fact(Kind.PASSIVE, text="cable, termination, bitrate?")


def error(cob_id, data=b""):
    return frame(cob_id, data, is_error_frame=True)


def disturbed(text):
    return Fact(Kind.DISTURBED, text=f"error frame: {text}")


def states(samples):
    return [drive.state for drive in samples.drives]


# -- with the simulated drives ---------------------------------------------------------------------


def started(bench, setups, make_drives):
    with bench.lockstep.serving():
        bench.boot(setups).boot_up()
    drives = make_drives(QueueWire(bench.bus))
    drives.start(0.0)
    return drives


def test_enable_move_stop_disable(bench, setups, make_drives):
    drives = started(bench, setups, make_drives)
    assert np.isnan(drives.samples.current).all()

    def run(ticks, power, velocity):
        for _ in range(ticks):
            samples = bench.tick(drives)
            assert samples.events == ()
            drives.command(power, velocity)
        return samples

    samples = run(10, PowerTarget.OFF, STILL)
    assert states(samples) == ["switch on disabled"] * N
    run(10, PowerTarget.ON, STILL)
    # Away from the end stops; each joint its own velocity, so that rows cannot be mixed up.
    velocity = np.array([0.1, 0.15, 0.2, -0.1, -0.3, -0.05, -0.25])
    before = run(100, PowerTarget.ON, velocity).link_position
    samples = run(50, PowerTarget.ON, velocity)
    assert states(samples) == ["operation enabled"] * N
    np.testing.assert_allclose(samples.motor_velocity, velocity, atol=0.05)
    np.testing.assert_allclose((samples.link_position - before) / 0.5, velocity, atol=0.05)
    plant = bench.simulated.plant
    np.testing.assert_allclose(samples.link_position, plant.q, atol=1e-4)
    samples = run(50, PowerTarget.QUICK_STOP, velocity)
    assert states(samples) == ["quick stop active"] * N
    np.testing.assert_allclose(samples.motor_velocity, STILL, atol=0.02)
    mixed = [PowerTarget.OFF] * 3 + [PowerTarget.QUICK_STOP] * 4
    samples = run(5, mixed, STILL)
    assert states(samples) == ["switch on disabled"] * 3 + ["quick stop active"] * 4
    assert samples.fresh.all()
    assert samples.events == ()


def test_samples_stay_as_they_were_taken(bench, setups, make_drives):
    first = make_drives(QueueWire(bench.bus)).samples
    drives = started(bench, setups, make_drives)
    for _ in range(3):
        taken = bench.tick(drives)
        drives.command(PowerTarget.OFF, STILL)
    copy = deepcopy(taken)
    bench.simulated.plant.q += 0.1
    for _ in range(30):
        drives.sync(bench.now)  # some answered, some not
        if bench.ticks % 2:
            bench.lockstep.pump()
        bench.ticks += 1
        drives.collect(bench.now)
        drives.command(PowerTarget.ON, STILL)
    assert np.isnan(first.current).all()
    assert states(first) == ["unknown"] * N
    assert states(drives.samples) == ["operation enabled"] * N
    for field in fields(taken):
        np.testing.assert_array_equal(getattr(taken, field.name), getattr(copy, field.name))
    with pytest.raises(ValueError, match="read-only"):
        taken.link_position[0] = 1.0


def test_drives_stop_by_themselves_when_the_loop_hangs(bench, setups, make_drives):
    drives = started(bench, setups, make_drives)
    for _ in range(50):
        bench.tick(drives)
        drives.command(PowerTarget.ON, np.full(N, 0.1))
    bench.simulated.advance(bench.simulated.now + 1.0)
    samples = bench.tick(drives)
    unheard = crossed(*(Emergency(node, 0x8130, 0x11) for node in range(1, N + 1)))
    assert set(samples.events) >= set(unheard)
    assert {drive.state.name for drive in bench.simulated.drives} == {"QUICK_STOP_ACTIVE"}
    assert not samples.fresh.any(), "they have left operational: no late setpoint moves them"


def test_an_orderly_end_causes_no_emergency(bench, setups, make_drives):
    drives = started(bench, setups, make_drives)
    for power in (PowerTarget.ON, PowerTarget.QUICK_STOP):
        for _ in range(20):
            bench.tick(drives)
            drives.command(power, STILL)
    drives.end()
    bench.lockstep.pump()
    with bench.lockstep.serving():
        bench.boot(setups).disable_monitoring()
    bench.simulated.advance(bench.simulated.now + 1.0)
    assert {drive.state.name for drive in bench.simulated.drives} == {"QUICK_STOP_ACTIVE"}
    while (message := bench.bus.recv(0)) is not None:
        assert not 0x80 < message.arbitration_id < 0x100, "no emergency"
        assert not 0x180 <= message.arbitration_id < 0x580, "no PDO"


def test_start_names_every_node_and_no_other(scripted, make_drives):
    make_drives(scripted).start(0.0)
    assert scripted.sent == [(0x77F, b"\x05")] + [
        (0x000, bytes([1, node])) for node in range(1, N + 1)
    ]


def test_heartbeats_are_sent_within_a_third_of_the_drives_timeout(scripted, drives):
    beats = []
    for k in range(1, 100):
        tick(drives, scripted, everything(), k * PERIOD_S)
        assert scripted.sent.pop() == (0x080, b""), "SYNC last"
        beats += [k * PERIOD_S for cob_id, _ in scripted.sent if cob_id == 0x77F]
        scripted.sent.clear()
    gaps = np.diff([0.0, *beats])
    assert gaps.max() <= 0.100 / 3
    assert gaps.min() > 2.5 * PERIOD_S, "and not more often than needed"


def test_drives_end_by_nmt_before_the_last_heartbeat(scripted, drives):
    drives.end()
    assert scripted.sent == [
        *((0x000, bytes([128, node])) for node in range(1, N + 1)),
        (0x77F, b"\x05"),
    ]


@pytest.mark.parametrize(
    ("message", "event"),
    [
        (frame(0x83, struct.pack("<HB5x", 0x8130, 0x11)), Emergency(3, 0x8130, 0x11)),
        (frame(0x703, b"\0"), restarted(3)),
        (frame(0x080), Fact(Kind.FOREIGN_MASTER, text="it sends 0x080")),
        (frame(0x000, b"\1\0"), Fact(Kind.FOREIGN_MASTER, text="it sends 0x000")),
        (frame(0x77F, b"\5"), Fact(Kind.FOREIGN_MASTER, text="it sends 0x77F")),
        (frame(0x203, bytes(6)), Fact(Kind.FOREIGN_MASTER, text="it sends 0x203")),
        (error(0x004, b"\0\x10" + bytes(6)), PASSIVE),  # receiving
        (error(0x004, b"\0\x20" + bytes(6)), PASSIVE),  # sending
        (error(0x004), PASSIVE),  # socketcand gives no more
        (error(0x004, b"\0\x08" + bytes(6)), disturbed("controller problem")),  # a warning
        (error(0x080, bytes(8)), disturbed("bus error")),
        (error(0x040), Fact(Kind.OFF_BUS)),
        (error(0x044, b"\0\x20" + bytes(6)), Fact(Kind.OFF_BUS)),
    ],
)
def test_an_event_beside_samples_is_reported_once(scripted, drives, message, event):
    assert tick(drives, scripted, [message]).events == crossed(event)
    assert event.text or event.kind is Kind.OFF_BUS
    assert tick(drives, scripted, []).events == (), "and is reported once"
    scripted.incoming.append(message)  # between two ticks
    assert tick(drives, scripted, []).events == crossed(event)


@pytest.mark.parametrize(
    "message",
    [
        frame(0x703, b"\5"), frame(0x583, bytes(8)), frame(0x708, b"\0"), frame(0x88, bytes(8)),
        frame(0x181, bytes(8), is_extended_id=True), frame(0x703, is_remote_frame=True),
    ],
)  # fmt: skip
def test_frames_of_others_are_no_events(scripted, drives, message):
    samples = tick(drives, scripted, [message])
    assert samples.events == ()
    assert {drive.detail for drive in samples.drives} == {"no reported state"}


def test_a_silent_drive_is_reported_after_three_heartbeat_periods(scripted, drives):
    for k in range(1, 40):
        beats = [frame(0x700 + node, b"\5") for node in range(1, N + 1) if node != 4 or k < 10]
        samples = tick(drives, scripted, beats + everything(), k * PERIOD_S)
        # Last heard in tick 9, three periods of 50 ms.
        assert samples.events == (crossed(Fact(Kind.SILENT, (4,))) if k == 25 else ())


def test_a_drive_that_leaves_operational_is_reported_and_stopped_by_sdo(scripted, drives):
    tick(drives, scripted, [frame(0x702, b"\5")])
    scripted.sent.clear()
    assert tick(drives, scripted, [frame(0x702, b"\x7f")]).events == crossed(dropped(2))
    drives.command(PowerTarget.QUICK_STOP, STILL)
    commanded = [data for cob_id, data in scripted.sent if cob_id == 0x602]
    assert commanded == [bytes.fromhex("2b40600002000000")], "it receives no setpoint, but SDO"


# What python-can and the sockets below it raise.
@pytest.mark.parametrize(
    ("failure", "kind"),
    [
        (can.CanOperationError("No buffer space available", errno.ENOBUFS), Kind.DISTURBED),
        (OSError(errno.ENOBUFS, "No buffer space available"), Kind.DISTURBED),
        (can.CanOperationError("Network is down", errno.ENETDOWN), Kind.DISTURBED),
        (OSError(errno.ENETDOWN, "Network is down"), Kind.DISTURBED),
        (OSError(errno.ENODEV, "No such device"), Kind.ADAPTER_GONE),
        (can.CanOperationError("No such device or address", errno.ENXIO), Kind.ADAPTER_GONE),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), Kind.ADAPTER_GONE),
        (ConnectionError("the peer has closed the connection"), Kind.ADAPTER_GONE),
        (ValueError("file descriptor cannot be a negative integer (-1)"), Kind.ADAPTER_GONE),
    ],
)
def test_a_bus_that_fails_is_an_event(scripted, drives, failure, kind):
    tick(drives, scripted, everything())
    scripted.failure = failure
    drives.command(PowerTarget.ON, STILL)
    drives.sync(2 * PERIOD_S)
    samples = drives.collect(2 * PERIOD_S)
    drives.end()
    assert {found.kind for found in samples.events} == {kind}
    assert len(samples.events) == 2, "once for sending, once for receiving"
    assert not samples.fresh.any()
    scripted.failure = None
    assert tick(drives, scripted, everything(), 3 * PERIOD_S).fresh.all(), "and it comes back"


def test_a_closed_bus_is_an_event(wire, make_drives):
    drives = make_drives(QueueWire(wire[0]))
    drives.start(0.0)
    wire[0].shutdown()
    drives.sync(PERIOD_S)
    samples = drives.collect(PERIOD_S)
    drives.command(PowerTarget.ON, STILL)
    assert {event.kind for event in samples.events} == {Kind.DISTURBED}


def test_frames_and_events_of_a_tick_are_bounded(scripted, drives):
    drives.sync(PERIOD_S)
    scripted.incoming += [
        frame(0x80 + 1 + k % N, struct.pack("<HB", k + 1, 1)) for k in range(2000)
    ]
    samples = drives.collect(PERIOD_S)
    assert len(scripted.incoming) == 2000 - FRAMES_PER_PASS
    assert len(samples.events) == EVENTS_PER_TICK


ANY_FRAME = st.builds(
    can.Message,
    arbitration_id=st.one_of(
        st.integers(0, 0x7FF),
        st.sampled_from([0x000, 0x080, 0x083, 0x181, 0x287, 0x201, 0x701, 0x77F]),
        st.integers(0, 0x1FFFFFFF),
    ),
    data=st.binary(max_size=8),
    is_extended_id=st.booleans(),
    is_error_frame=st.booleans(),
    is_remote_frame=st.booleans(),
    is_rx=st.booleans(),
)


@settings(max_examples=scaled(150))
@given(ticks=st.lists(st.lists(ANY_FRAME, max_size=40), max_size=5))
def test_no_frame_makes_an_exception(joint_drives, ticks):
    bus = ScriptedWire()
    drives = CanopenDrives(bus, joint_drives, PERIOD_S, lambda: 0.0)
    drives.start(0.0)
    absent = False  # bus-off: until all have confirmed a stop, which none does here
    for k, frames in enumerate(ticks, start=1):
        samples = tick(drives, bus, frames, k * PERIOD_S)
        bus.sent.clear()
        drives.command(PowerTarget.ON, np.full(N, 0.1))
        assert len(samples.events) <= EVENTS_PER_TICK
        assert samples.age_s.max() <= k * PERIOD_S
        absent = absent or Kind.OFF_BUS in {event.kind for event in samples.events}
        sent = {id_ - 0x201: data for id_, data in bus.sent if id_ in range(0x201, 0x201 + N)}
        unset = {drives.names.index(name) for name in drives.restarted()}
        assert set(sent) == (set() if drives.silenced else set(range(N)) - unset)
        moved = {joint for joint, data in sent.items() if data[2:] != bytes(4)}
        conditions = [drive.condition for drive in samples.drives]
        in_operation = {i for i in range(N) if conditions[i] is DriveCondition.OPERATING}
        assert moved == (set() if absent or drives.silenced else in_operation - unset)


def test_a_start_forgets_earlier_frames(scripted, drives):
    tick(drives, scripted, everything())
    for _ in range(6):
        tick(drives, scripted, [frame(0x703, b"\0"), frame(0x84, struct.pack("<HB", 0x8130, 1))])
    assert drives.unfit() == [2]
    scripted.incoming += everything()
    drives.start(1.0)
    assert drives.unfit() == []
    samples = tick(drives, scripted, [], 1.01)
    assert samples.events == ()
    assert samples.starting.all(), "they may still be on their way"
    assert list(samples.age_s) == [PERIOD_S] * N, "what was before is not of now"


def test_a_drive_is_unfit_for_a_reset_when_it_forgot_is_silent_or_locked(scripted, drives):
    tick(drives, scripted, everything(0x08))
    assert drives.unfit() == [], "an ordinary fault needs an ordinary reset"
    lost = [frame(0x80 + 4, struct.pack("<HB", 0x8130, 0x11)), frame(0x702, b"\5")]
    tick(drives, scripted, [*lost, *everything(0x08)], 0.02)
    assert drives.unfit() == [3], "in fault for the loss of its master"
    for code in (0, 0x2310):
        other = frame(0x80 + 4, struct.pack("<HB", code, 1))
        tick(drives, scripted, [other, *everything(0x08)], 0.02)
        assert drives.unfit() == [3], "the loss of its master may outlast later emergencies"
    tick(drives, scripted, [frame(0x702, b"\x7f"), *everything(0x08)], 0.03)
    assert drives.unfit() == [1, 3], "no longer operational"
    over = [frame(0x80 + 4, struct.pack("<HB", 0, 0)), frame(0x702, b"\5")]
    tick(drives, scripted, [*over, *everything(0x08)], 0.16)
    assert drives.unfit() == [*range(N)], "silent for three heartbeats, or still unset"


# -- drives that are set up again, and those that are not ------------------------------------------


def receivers(scripted):
    return sorted(cob_id for cob_id, _ in scripted.sent if cob_id & 0x780 == 0x200)


@pytest.mark.parametrize(
    "lost", [frame(0x703, b"\0"), frame(0x703, b"\x7f"), frame(0x703, b"\4")], ids=str
)
def test_no_setpoint_goes_to_a_drive_that_is_not_set_up(scripted, drives, lost):
    def reached():
        for send in (lambda: drives.command(PowerTarget.ON, STILL), drives.quick_stop):
            scripted.sent.clear()
            send()
            yield receivers(scripted)

    tick(drives, scripted, [frame(0x703, b"\5"), *everything()])
    tick(drives, scripted, [lost, *everything()], 0.02)
    every = [0x200 + node for node in range(1, N + 1)]
    assert list(reached()) == [[cob_id for cob_id in every if cob_id != 0x203]] * 2
    drives.start(0.03, [2])
    assert list(reached()) == [every] * 2


def test_a_drive_that_is_not_trusted_gets_nothing_until_it_was_set_up_again(scripted, drives):
    tick(drives, scripted, everything())
    drives.distrust([4])
    assert drives.unfit() == [4]
    drives.start(0.02, [])
    started = [data[1] for cob_id, data in scripted.sent if cob_id == 0]
    assert started == [node for node in range(1, N + 1) if node != 5]
    drives.command(PowerTarget.ON, STILL)
    assert 0x205 not in receivers(scripted)
    drives.start(0.03, [4])
    assert drives.unfit() == []


EMERGENCIES = {
    code: struct.pack("<HB5x", code, 1) for code in (0x8130, 0x8220, 0x2310)
}  # of a lost master, of a PDO, of a current


def test_frames_during_a_set_up_are_reported_with_the_next_samples(scripted, drives):
    tick(drives, scripted, [frame(0x700 + node, b"\5") for node in (2, 3)])
    heard = [
        (0x703, b"\0"),  # of the drive that is set up again: its boot-up, and that it has no PDOs
        (0x703, b"\x7f"),
        *((0x83, data) for data in EMERGENCIES.values()),
        *((0x82, data) for data in EMERGENCIES.values()),
        (0x702, b"\x7f"),  # of another: it has left operational
        (0x080, b""),
    ]
    drives.start(1.05, [2], heard)
    samples = tick(drives, scripted, everything(), 1.06)
    assert samples.events == crossed(
        Emergency(3, 0x2310, 1),
        *(Emergency(2, code, 1) for code in EMERGENCIES),
        dropped(2),
        Fact(Kind.FOREIGN_MASTER, text="it sends 0x080"),
    )
    assert drives.restarted() == (drives.names[1],)


@pytest.mark.parametrize(
    ("code", "queued", "soon", "later"),
    [(0x8220, False, False, True), (0x8210, False, False, True), (0x8130, False, True, True),
     (0x2310, True, True, True)],
)  # fmt: skip
def test_emergencies_of_a_restart_end_with_the_set_up(scripted, drives, code, queued, soon, later):
    """Emergencies of the wire's queue, of the first half second after the set-up, and of later."""
    said = frame(0x83, struct.pack("<HB5x", code, 1))

    def heard(frames, now):
        events = tick(drives, scripted, [*frames, *everything()], now).events
        return set(crossed(Emergency(3, code, 1))) <= set(events)

    scripted.incoming.append(said)
    drives.start(1.0, [2])
    assert heard([], 1.01) is queued
    assert heard([said], 1.4) is soon
    assert heard([said], 1.51) is later


def test_a_boot_up_queued_during_a_set_up_is_reported(scripted, drives):
    scripted.incoming.append(frame(0x703, b"\0"))
    drives.start(1.0, [2])
    assert tick(drives, scripted, everything(), 1.01).events == crossed(restarted(3))
    assert drives.unfit() == [2]


def test_the_state_of_a_drive_outlasts_the_set_up_of_another(scripted, drives):
    tick(drives, scripted, everything())
    both = [frame(0x703, b"\0"), frame(0x702, b"\0")]
    tick(drives, scripted, [*both, *everything()], 0.02)
    tick(drives, scripted, [frame(0x704, b"\5"), *everything()], 0.2)
    assert drives.unfit() == [0, 1, 2, 4, 5, 6], "all but node 4 are silent"
    drives.start(0.5, [2, 4])
    assert drives.unfit() == [0, 1, 5, 6]
    assert tick(drives, scripted, everything(), 0.51).events == ()
    assert drives.restarted() == (drives.names[1],)


def test_an_answer_from_before_a_start_is_no_event(scripted, drives):
    tick(drives, scripted, everything())
    scripted.incoming += everything()
    drives.start(0.05, [])
    assert tick(drives, scripted, everything(), 0.06).events == ()
