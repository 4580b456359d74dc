"""Scan of a bus: it reads, finds who is there, and gives way to a master."""

import struct
from collections import deque

import pytest

from bench.rigs.generated_arms import generate
from bench.rigs.lines import virtual_line
from bench.rigs.sync_clock import Lockstep
from common.errors import BusError, ConfigurationError
from common.yaml_source import parse_yaml
from daemon.config.load import load_robot
from drivers.canopen.boot.scan import FoundNode, scan
from programs.contactd.scan import bus_of, data_sheets, fitting, table
from programs.simulate.simulated_robot import true_arm
from simulator.arm import SimulatedArm


class Bus:
    """Wire to nodes that are scripts: node -> what it answers to a request."""

    def __init__(self, nodes, heard=()):
        self.nodes, self.frames, self.sent = nodes, deque(heard), []

    def receive(self, timeout):
        return self.frames.popleft() if self.frames else None

    def send(self, frames):
        for can_id, data in frames:
            self.sent.append((can_id, bytes(data)))
            answer = self.nodes.get(can_id - 0x600)
            if answer is not None:
                self.frames.extend(answer(*struct.unpack_from("<HB", data, 1)))


def drive(node, values):
    """A node with these objects, of four bytes."""

    def answer(index, subindex):
        value = values.get((index, subindex))
        head = (0x43, value) if value is not None else (0x80, 0x06020000)
        return [(0x580 + node, struct.pack("<BHBI", head[0], index, subindex, head[1]))]

    return answer


OBJECTS = {
    (0x1000, 0): 0x00020192, (0x1018, 1): 0xC0, (0x1018, 2): 0x501, (0x1018, 3): 1,
    (0x1018, 4): 4711, (0x6502, 0): 0x104,
}  # fmt: skip


def quick(bus, **more):
    return scan(bus, listen_s=0.01, answer_s=0.03, **more)


def test_who_answers_is_found_and_nothing_but_reading_is_sent():
    bus = Bus({5: drive(5, OBJECTS), 9: drive(9, {(0x1000, 0): 0x191})})
    assert quick(bus) == [
        FoundNode(5, 0x20192, 0xC0, 0x501, 1, 4711, 0x104),
        FoundNode(9, 0x191, None, None, None, None, None),
    ]
    assert {can_id & ~0x7F for can_id, _ in bus.sent} == {0x600}
    assert {data[0] for _, data in bus.sent} == {0x40}
    assert {can_id - 0x600 for can_id, _ in bus.sent} == set(range(1, 128))


def test_two_nodes_of_one_number_are_named():
    answer = drive(5, OBJECTS)
    bus = Bus({5: lambda *what: 2 * answer(*what), 9: drive(9, OBJECTS)})
    found = quick(bus)
    assert [one.twice for one in found] == [True, False]
    assert table(found, {})[-1].startswith("two drives answer as node 5: ")


@pytest.mark.parametrize(
    "noise",
    [
        (0x585, b"\x43\x00\x10\x00"),  # too short
        (0x585, struct.pack("<BHBI", 0x43, 0x2000, 0, 7)),  # of another object
        (0x5F0, struct.pack("<BHBI", 0x43, 0x1000, 0, 7)),  # of a node that was not asked
        (0x185, bytes(8)),
    ],
)
def test_what_is_no_answer_is_none(noise):
    bus = Bus({5: lambda *what: [noise, *drive(5, OBJECTS)(*what)]})
    (found,) = quick(bus, nodes=[5])
    assert found.serial == 4711


def test_a_value_of_two_bytes_and_one_in_segments():
    def answer(index, subindex):
        if index == 0x1000:
            return [(0x585, struct.pack("<BHBI", 0x4B, index, subindex, 0xFFFF0192))]
        return [(0x585, struct.pack("<BHBI", 0x41, index, subindex, 20))]

    assert quick(Bus({5: answer}), nodes=[5]) == [FoundNode(5, 0x192, *[None] * 5)]


@pytest.mark.parametrize(
    ("heard", "says"),
    [
        ((0x080, b""), "sends SYNC"),
        ((0x000, b"\x01\x00"), "sends NMT commands"),
        ((0x603, bytes(8)), "sends SDO requests to node 3"),
        ((0x77F, b"\x05"), "node 127 sends heartbeats but answers no SDO"),
    ],
)
def test_it_gives_way_to_a_master(heard, says, monkeypatch):
    monkeypatch.setattr("drivers.canopen.boot.scan.ANSWER_S", 0.02)
    bus = Bus({5: drive(5, OBJECTS)}, [heard])
    with pytest.raises(BusError, match=says):
        quick(bus)
    assert all(can_id == 0x600 + 127 for can_id, _ in bus.sent)


def test_a_drive_that_beats_is_no_master():
    bus = Bus({5: drive(5, OBJECTS)}, [(0x705, b"\x7f")])
    assert [one.node for one in quick(bus)] == [5]


def test_the_drives_of_a_simulated_arm_are_found_with_their_eds(tmp_path):
    arm = generate(1)
    folder = arm.write(tmp_path / "arm")
    (folder / "broken.eds").write_text("no EDS")
    description, simulation = true_arm(load_robot(folder))
    with virtual_line() as line:
        simulated = SimulatedArm(description, simulation.settings, line.far.send)
        lockstep = Lockstep(simulated, line.far)
        simulated.power_on()
        lockstep.pump()
        with lockstep.serving():
            found = scan(line.near.wire, listen_s=0.05, answer_s=0.2)
    nodes = sorted(joint["wiring"]["node"] for joint in arm.joints)
    assert [one.node for one in found] == nodes
    assert {one.product for one in found} == {arm.make.product}
    assert {one.mode_names for one in found} == {"csv"}
    sheets = data_sheets(folder)
    assert all(fitting(one, sheets) == ["drive.eds"] for one in found)
    assert table(found, sheets)[1].split() == [
        str(nodes[0]), "0xC0DAC8", "0x502", str(found[0].serial), "csv", "drive.eds",
    ]  # fmt: skip
    assert {drive.nmt.name for drive in simulated.drives} == {"PRE_OPERATIONAL"}


def test_an_eds_of_another_product_does_not_fit():
    one = FoundNode(5, 0x20192, 0xC0, 0x501, 1, 4711, 0x100)
    sheets = {
        "a.eds": {"VendorNumber": 0xC0, "ProductNumber": 0x501},
        "b.eds": {"VendorNumber": 0xC0, "ProductNumber": 0x502},
        "c.eds": {"VendorNumber": 0xC0},
        "d.eds": {},
    }
    assert fitting(one, sheets) == ["a.eds", "c.eds"]
    assert "none in this folder" in table([one], {})[1]
    assert table([], sheets)[0].startswith("no node answers")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("joints: 3\n", "`bus` is missing"),
        ("bus: {interface: carrier_pigeon, channel: a}\n", r"bus.interface: must be one of slcan"),
    ],
)
def test_a_bus_that_is_not_described_is_refused(text, says, tmp_path):
    with pytest.raises(ConfigurationError, match=says):
        bus_of(parse_yaml(text, tmp_path / "config.yaml"))


def test_only_the_bus_is_read(tmp_path):
    source = parse_yaml("bus: {interface: socketcan, channel: can1}\njoints: wrong\n", tmp_path)
    assert bus_of(source).channel == "can1"


@pytest.mark.parametrize("heard", [(0x080, b""), (0x000, bytes([1, 0]))])
def test_it_ends_where_a_master_begins_meanwhile(heard):
    bus = Bus({5: lambda *_: [heard]})
    with pytest.raises(BusError, match="a master started during the scan"):
        quick(bus)
    assert len(bus.sent) < 20
