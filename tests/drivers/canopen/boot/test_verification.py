"""Contents of drives, read back without writing: every object that matters, each named."""

import struct
from dataclasses import replace

import msgspec
import pytest

from drivers.canopen.boot.verification import all_required
from simulator.objects import key

NODE_3 = 2


def verify(bench, setups, joints=None, meanwhile=lambda: None):
    boot = bench.boot(setups)
    boot.identities = bench.identities
    with bench.lockstep.serving():
        return boot.verify(range(len(setups)) if joints is None else joints, meanwhile)


class Booted:
    """The bench, set up, with what was known of its drives then."""

    def __init__(self, bench, setups):
        self.identities = bench.boot_up(setups)
        self.bench, self.lockstep, self.boot = bench, bench.lockstep, bench.boot
        self.drives = bench.simulated.drives


@pytest.fixture
def booted(bench, setups):
    return Booted(bench, setups)


def test_drives_that_hold_all_hold_all(booted, setups):
    assert verify(booted, setups) == {}


def test_every_object_is_read_once_and_none_is_written(booted, setups):
    asked, written = [], []
    drive = booted.drives[NODE_3]
    on_sdo = drive.on_sdo
    drive.on_sdo = lambda data: (asked.append(struct.unpack_from("<BHB", data)), on_sdo(data))
    drive.objects.written = written.append
    assert verify(booted, setups, [NODE_3]) == {}
    places = [(index, sub) for _, index, sub in asked]
    assert {command for command, _, _ in asked} == {0x40}, "uploads alone"
    assert len(places) == len(set(places))
    assert written == []
    rows = {(row.index, row.subindex) for row in all_required(setups[NODE_3], 10, 127)}
    rows &= {(k >> 8, k & 0xFF) for k, entry in drive.objects.entries.items() if entry.writable}
    assert rows | {(0x6041, 0), (0x6061, 0), (0x1018, 1), (0x1018, 2), (0x1018, 4)} == set(places)


def test_each_object_that_another_has_written_is_named(booted, setups):
    """One after the other: an object more or less in a table would not be noticed otherwise."""
    drive = booted.drives[NODE_3]
    for row in all_required(setups[NODE_3], 10, 127):
        where = key(row.index, row.subindex)
        if where not in drive.objects.entries or not drive.objects.entries[where].writable:
            continue  # it has none, or no one can have changed it
        before = drive.objects.values[where]
        drive.objects.values[where] = before ^ (1 << 31 if row.mask == 1 << 31 else 1)
        found = verify(booted, setups, [NODE_3])
        drive.objects.values[where] = before
        assert list(found) == [NODE_3], row
        (words,) = found[NODE_3]
        assert words.startswith(f"{row.where} reads ")
    assert verify(booted, setups) == {}


SAYS = [
    ({(0x6060, 0): 1}, "object 0x6060:00 (cyclic synchronous velocity) reads 1, must be 9"),
    ({(0x6061, 0): 8}, "object 0x6061:00 (mode of operation display) reads 8, must be 9"),
    ({(0x6061, 0): 0}, None),
    (
        {(0x1005, 0): 0x81},
        "object 0x1005:00 (SYNC on 0x080, not produced by the drive) reads 129, must be 128",
    ),
    (
        {(0x1A00, 2): 0x60770010},
        "object 0x1A00:02 (current in TPDO 1) reads 0x60770010, must be 0x60780010",
    ),
    (
        {(0x1400, 1): 0x80000203},
        "object 0x1400:01 (COB-ID of RPDO 1) reads 0x80000203, must be 0x00000203",
    ),
    (
        {(0x1801, 1): 0x00000283},  # the bit of remote requests is the drive's own
        None,
    ),
    (
        {(0x1803, 1): 0x483},
        "object 0x1803:01 (a disabled PDO) reads 0x00000483, must be 0x80000000",
    ),
    ({(0x1018, 4): 99}, "object 0x1018:04 (serial) reads 0x63, was 0x3"),
    ({(0x1018, 2): 7}, "object 0x1018:02 (product) reads 0x7, was 0x402"),
]


def test_what_it_says(booted, setups):
    values = booted.drives[NODE_3].objects.values
    for changes, words in SAYS:
        before = dict(values)
        values.update({key(*where): value for where, value in changes.items()})
        assert verify(booted, setups) == ({NODE_3: [words]} if words else {}), changes
        values.update(before)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x8130, "in fault for heartbeat of the master lost (0x8130)"),
        (0x8220, "in fault for PDO too long (0x8220)"),
        (0, "in fault of unknown cause: object 0x603F reads 0"),
        (0x2310, None),
    ],
)
def test_a_fault_of_communication_is_one_that_a_reset_may_not_end(booted, setups, code, words):
    drive = booted.drives[NODE_3]
    drive.fault(0x2310, "too much current")
    drive.tick(0.0)
    drive.objects.values[key(0x603F)] = code
    assert verify(booted, setups) == ({NODE_3: [words]} if words else {})


def test_a_drive_that_does_not_answer_keeps_no_one(booted, setups):
    silent = setups[NODE_3]
    profile = msgspec.structs.replace(silent.drive.profile, sdo_timeout_ms=100)
    silent = replace(silent, drive=replace(silent.drive, profile=profile))
    booted.drives[NODE_3].on_sdo = lambda _: None
    heard, called = [], []
    other = booted.drives[0]
    other.on_heartbeat = lambda node, _: heard.append(node)
    found = verify(
        booted, [*setups[:2], silent, *setups[3:]], meanwhile=lambda: called.append(None)
    )
    assert list(found) == [NODE_3]
    assert found[NODE_3][0].startswith("does not answer (SDO timeout 30 ms")
    assert set(heard) == {127}
    assert len(called) == len(heard)
