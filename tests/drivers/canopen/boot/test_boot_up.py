"""Boot-up against the simulated drives, as they are and with one thing wrong."""

import copy
import re
import threading
import time
from dataclasses import replace

import can
import pytest

from common.errors import BusError, ConfigurationError, DriveError
from drivers.can.frame_ring import FrameRing, read_frames
from drivers.can.virtual import QueueWire
from drivers.canopen.boot.boot_up import DriveBoot, refuse_other_master
from simulator.objects import key
from tests.drivers.canopen.boot.changed_setups import third, with_profile, with_wiring


def threads():
    return {thread.name for thread in threading.enumerate()}


def test_boot_up_reports_the_identity_of_every_drive(bench, setups):
    lines = []
    before = threads()
    identities = bench.boot_up(setups, progress=lines.append)
    assert threads() == before, "the reader is gone"
    assert [(i.name, i.node, i.serial) for i in identities] == [
        (setup.drive.name, setup.drive.node, setup.drive.node) for setup in setups
    ]
    assert {(i.vendor, i.product, i.revision) for i in identities} == {(0xC0DAC7, 0x402, 0x10000)}
    assert lines[2] == (
        "node 3 (LElbowRoll): contactd simulated two-encoder servo drive, vendor 0xC0DAC7, "
        "product 0x402, revision 0x10000, serial 3"
    )
    assert re.fullmatch(
        r"node 7 \(LWristPitch\): set up and read back in \d+ ms \(pre-operational, "
        r"communication, stopping, mode, limits, own objects, PDO mapping\)",
        lines[-1],
    )
    bench.bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False))
    assert bench.other_end.recv(0) is not None, "the bus is still open"


def test_every_drive_holds_what_was_written(bench, setups):
    bench.boot_up(setups)
    wanted = {
        (0x1016, 1): 127 << 16 | 100,
        (0x1017, 0): 50,
        (0x1029, 1): 0,
        (0x6007, 0): 3,
        (0x605A, 0): 6,
        (0x605E, 0): 2,
        (0x6060, 0): 9,
        (0x6061, 0): 9,
        (0x60C2, 1): 10,
        (0x6072, 0): 2000,
        (0x6073, 0): 2000,
        (0x6080, 0): round(1.1 * 1.2 * 100 * 60 / (2 * 3.14159265) + 0.5),
        (0x1400, 1): 0x203,
        (0x1400, 2): 1,
        (0x1600, 0): 2,
        (0x1600, 1): 0x60400010,
        (0x1600, 2): 0x60FF0020,
        (0x1800, 1): 0x40000183,
        (0x1800, 2): 1,
        (0x1A00, 0): 3,
        (0x1A00, 1): 0x60410010,
        (0x1A00, 2): 0x60780010,
        (0x1A00, 3): 0x606C0020,
        (0x1801, 1): 0x40000283,
        (0x1A01, 0): 2,
        (0x1A01, 1): 0x60E40120,
        (0x1A01, 2): 0x60640020,
    }
    assert {where: bench.number(2, *where) for where in wanted} == wanted
    assert bench.number(2, 0x60C2, 2) == -3
    # 12 rad/s2 at the link, behind a gear of 100, in 0.1 rpm/s.
    assert bench.number(2, 0x6085) == round(12 * 100 / 0.010471975511965977)


def test_unused_pdos_are_disabled(bench, setups):
    bench.boot_up(setups)
    for drive in range(len(setups)):
        for communication in (0x1401, 0x1402, 0x1403, 0x1802, 0x1803):
            assert bench.number(drive, communication, 1) >> 31 == 1


def test_boot_up_may_be_repeated(bench, setups):
    assert bench.boot_up(setups) == bench.boot_up(setups)


def test_objects_of_the_configuration_are_written_last(bench, setups):
    write = [{"object": 0x6080, "value": 3000}, {"object": 0x6073, "value": 1500}]
    bench.boot_up([with_profile(setup, write=write) for setup in setups])
    assert bench.number(0, 0x6080) == 3000
    assert bench.number(0, 0x6073) == 1500


def test_an_absent_drive_is_named_before_anything_is_written(bench, setups):
    with pytest.raises(DriveError, match=r"node 99 \(LElbowRoll\) does not answer \(SDO timeout"):
        bench.boot_up(third(setups, with_wiring(setups[2], node=99)))
    assert bench.number(0, 0x6007) == 0, "nothing is written before everybody has answered"


@pytest.mark.parametrize(
    ("where", "value", "says"),
    [
        ((0x1000, 0), 0x00020191, "a CiA 402 drive: .* profile 401, expected 402; step `identity`"),
        ((0x6502, 0), 0x80, "no cyclic synchronous velocity"),
        ((0x6075, 0), 1000, r"0x6075:00 reads a rated current of 1 A, configured 1.2 A"),
    ],
)
def test_another_drive_than_configured_is_refused(bench, setups, where, value, says):
    bench.simulated.drives[2].objects.values[key(*where)] = value
    with pytest.raises(DriveError, match=r"node 3 \(LElbowRoll\).*" + says):
        bench.boot_up(setups)


def test_another_serial_number_is_refused(bench, setups):
    with pytest.raises(DriveError, match="serial number 3, configured 1234"):
        bench.boot_up([*setups[:2], with_wiring(setups[2], serial=1234)])


@pytest.mark.parametrize(
    ("subindex", "says"),
    [
        (1, r"0x1018:01 reads 0x999, but VendorNumber is 0xC0DAC7; set drives\.two_"),
        (2, r"0x1018:02 reads 0x999, but ProductNumber is 0x402; .* or "
         r"drives\.two_encoder_drive\.any_product to true; step `identity`"),
    ],
)  # fmt: skip
def test_another_product_than_that_of_the_eds_is_refused(bench, setups, subindex, says):
    bench.simulated.drives[2].objects.values[key(0x1018, subindex)] = 0x999
    with pytest.raises(DriveError, match=r"node 3 \(LElbowRoll\) is another product .*" + says):
        bench.boot_up(setups)
    bench.boot_up([with_profile(setup, any_product=True) for setup in setups])


@pytest.mark.parametrize("number", [None, 0])
def test_an_eds_without_a_product_number_is_not_compared(bench, setups, number):
    sheet = copy.deepcopy(setups[2].data_sheet)
    sheet.device_information.product_number = number
    bench.simulated.drives[2].objects.values[key(0x1018, 2)] = 0x999
    lines = []
    bench.boot_up([replace(setups[2], data_sheet=sheet)], progress=lines.append)
    said = "its EDS has no ProductNumber: its product is not compared"
    assert f"drive profile two_encoder_drive: {said}" in lines


def forgetful(drive, where, value, only=True):
    """The drive accepts a write of this object, or of any, and then has `value` in it."""
    written = drive.objects.written

    def hook(key_written):
        written(key_written)
        if key_written == key(*where) or not only:
            drive.objects.values[key(*where)] = value

    drive.objects.written = hook


@pytest.mark.parametrize(
    ("where", "kept", "says"),
    [
        ((0x6007, 0), 0, "object 0x6007:00 .* was written 3, reads 0; step `stopping`"),
        ((0x1016, 1), 0, "object 0x1016:01 .* was written 8323172, reads 0"),
        ((0x1A00, 3), 0, r"object 0x1A00:03 was written 1617690656, reads 0"),
        ((0x1800, 2), 255, "object 0x1800:02 was written 1, reads 255"),
        ((0x1400, 1), 0x80000203, "object 0x1400:01 was written 0x00000203, reads 0x80000203"),
        ((0x1803, 1), 0x483, "object 0x1803:01 reads 0x00000483: the PDO stays enabled"),
    ],
)
def test_a_drive_that_does_not_keep_a_value_is_refused(bench, setups, where, kept, says):
    forgetful(bench.simulated.drives[2], where, kept)
    with pytest.raises(DriveError, match=r"node 3 \(LElbowRoll\): " + says):
        bench.boot_up(setups)


def test_a_drive_that_shows_another_mode_is_refused(bench, setups):
    forgetful(bench.simulated.drives[2], (0x6061, 0), 8, only=False)
    with pytest.raises(DriveError, match="the drive shows mode 8"):
        bench.boot_up(setups)


def test_a_drive_that_shows_its_mode_late_is_accepted(bench, setups):
    drive = bench.simulated.drives[2]
    read, shown = drive.objects.read, iter([8, 8, 8])

    def late(index, subindex):
        if index == 0x6061:
            drive.objects.values[key(0x6061)] = next(shown, 9)
        return read(index, subindex)

    drive.objects.read = late
    bench.boot_up(setups)
    assert next(shown, None) is None, "it was asked until it showed the mode"


def test_a_refused_write_is_reported_with_its_reason(bench, setups):
    with pytest.raises(
        DriveError, match=r"0x605E:00: writing 1 was refused: Value range .* \(0x06090030\)"
    ):
        bench.boot_up([*setups[:2], with_profile(setups[2], fault_reaction=1)])


def test_a_value_outside_the_eds_is_refused_before_it_is_sent(bench, setups):
    with pytest.raises(ConfigurationError, match=r"object 0x605E:00 .*: -5 is outside 0 \.\.\. 2"):
        bench.boot([with_profile(setups[2], fault_reaction=-5)]).boot_up()
    assert bench.other_end.recv(0) is None


@pytest.mark.parametrize(
    ("cob_id", "says"),
    [(0x77F, r"another master \(node 127\) is on this bus"), (0x080, "SYNC is being sent")],
)
def test_another_master_is_refused(bench, setups, cob_id, says):
    bench.other_end.send(can.Message(arbitration_id=cob_id, is_extended_id=False, data=b""))
    with pytest.raises(BusError, match=says):
        bench.boot(setups).boot_up()


def test_a_drives_heartbeat_is_no_other_master(wire):
    for cob_id in (0x701, 0x181, 0x77E):
        wire[1].send(can.Message(arbitration_id=cob_id, is_extended_id=False))
    wire[1].send(can.Message(arbitration_id=0x77F, is_extended_id=True))
    refuse_other_master(QueueWire(wire[0]), 127, 0.01)


# -- what the sequence meets on its way ------------------------------------------------------------


def test_a_constant_object_must_have_the_wanted_value(bench, setups):
    setup = setups[2]
    sheet = copy.deepcopy(setup.data_sheet)
    sheet[0x6007].access_type = "const"
    with pytest.raises(DriveError, match=r"0x6007:00 .* must be 3, reads 0; step `stopping`"):
        bench.boot_up([replace(setup, data_sheet=sheet)])
    bench.simulated.drives[2].objects.values[key(0x6007)] = 3
    bench.boot_up([replace(setup, data_sheet=sheet)])


def fixed_pdos(setup):
    """The setup with an EDS that lets no one change a PDO, and says not what is mapped."""
    sheet = copy.deepcopy(setup.data_sheet)
    for index in (0x1400, 0x1600, 0x1800, 0x1801, 0x1A00, 0x1A01):
        for member in sheet[index].values():
            member.access_type, member.default = "const", None
    return replace(setup, data_sheet=sheet)


def test_fixed_pdos_are_accepted_if_they_are_as_configured(bench, setups):
    bench.boot_up(setups)
    drive = bench.simulated.drives[2]
    written = []
    write = drive.objects.write
    drive.objects.write = lambda *where: (written.append(where[0]), write(*where))
    setup = fixed_pdos(setups[2])
    bench.boot_up([setup])
    assert [index for index in written if index in (0x1400, 0x1801, 0x1A00)] == []
    assert 0x1401 in written, "what is left over and can be written is disabled"
    for where, value, says in (
        ((0x1A00, 2), 0x60770010, "0x1A00:02 must be 1618477072, reads 1618411536"),
        ((0x1600, 0), 1, "0x1600:00 must be 2, reads 1"),
        ((0x1800, 2), 254, "0x1800:02 must be 1, reads 254"),
        ((0x1400, 1), 0x80000203, "0x1400:01 must be 0x00000203, reads 0x80000203"),
    ):
        kept = drive.objects.values[key(*where)]
        drive.objects.values[key(*where)] = value
        with pytest.raises(DriveError, match=f"{says}; step `PDO mapping`"):
            bench.boot_up([setup])
        drive.objects.values[key(*where)] = kept


def test_an_unused_constant_pdo_is_refused_unless_it_is_disabled(bench, setups):
    bench.boot_up(setups)
    setup = fixed_pdos(setups[2])
    setup.data_sheet[0x1803][1].access_type = "ro"
    bench.boot_up([setup])
    bench.simulated.drives[2].objects.values[key(0x1803, 1)] = 0x483
    with pytest.raises(DriveError, match="0x1803:01 reads 0x00000483: the PDO stays enabled"):
        bench.boot_up([setup])


def test_the_frame_ring_holds_requests_and_answers(bench, setups, tmp_path):
    ring = FrameRing(tmp_path / "frames", 10_000, time.monotonic)
    heard = []
    send = bench.simulated._send
    bench.simulated._send = lambda message: (heard.append(message), send(message))
    bench.boot_up(setups, ring=ring)
    kept = read_frames(ring.path)
    assert (0x603, bytes.fromhex("4000100000000000")) in said(kept, True), "0x1000 is asked for"
    assert said(kept, True).count((0x000, b"\x80\x03")) == 1
    answers = [(m.arbitration_id, bytes(m.data)) for m in heard if m.arbitration_id > 0x580]
    assert [frame for frame in said(kept, False) if frame[0] > 0x580] == answers
    asked = [cob_id for cob_id, _ in said(kept, True) if 0x600 < cob_id < 0x680]
    assert len(asked) == len([a for a in answers if a[0] < 0x600]), "a request, an answer"
    ring.close()


def said(kept, sent):
    return [(frame.can_id, frame.data) for frame in kept if frame.sent is sent]


def test_boot_up_on_a_closed_bus_is_a_bus_error(wire, setups):
    wire[0].shutdown()
    with pytest.raises(BusError, match="closed bus"):
        DriveBoot(QueueWire(wire[0]), setups, 10, listen_s=0.005).boot_up()
