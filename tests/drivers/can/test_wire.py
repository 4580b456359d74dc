"""Frames in and out of sockets and of python-can, the same through every wire."""

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import can
import pytest
from can.interfaces.socketcand.socketcand import convert_can_message_to_ascii_message
from hypothesis import example, given
from hypothesis import strategies as st

from drivers.can.socketcan import RawWire
from drivers.can.socketcand import StreamWire
from drivers.can.virtual import QueueWire
from drivers.can.wire import ERROR, EXTENDED, IDENTIFIER, REMOTE
from tests.drivers.can.message_wire import MessageWire

FRAMES = [
    (0x080, b""),
    (0x201, bytearray(b"\x0f\x00\xff\xff\xff\xff")),
    (0x77F, b"\x05"),
    (0x1200FD01 | EXTENDED, bytes(range(8))),
]
TPDO = b"\x27\x02\x64\x00\xe8\x03\x00\x0a"


@contextmanager
def pair(kind: int) -> Iterator[tuple[socket.socket, socket.socket]]:
    near, far = socket.socketpair(socket.AF_UNIX, kind)
    with near, far:
        yield near, far


@pytest.fixture
def packets() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Two ends that keep packets apart, as a CAN_RAW socket does."""
    with pair(socket.SOCK_SEQPACKET) as ends:
        yield ends


@pytest.fixture
def stream() -> Iterator[tuple[socket.socket, socket.socket]]:
    with pair(socket.SOCK_STREAM) as ends:
        yield ends


def test_raw_frames_have_linux_layout(packets):
    near, far = packets
    RawWire(near).send(FRAMES)
    for can_id, data in FRAMES:
        assert far.recv(72) == struct.pack("=IB3x8s", can_id, len(data), data)


@pytest.mark.parametrize("can_id", [0x181, 0x181 | EXTENDED, 0x40 | ERROR, 0x701 | REMOTE])
@pytest.mark.parametrize("data", [b"", b"\x27", TPDO])
def test_raw_frames_are_read(packets, can_id, data):
    near, far = packets
    wire = RawWire(near)
    assert wire.receive(0.0) is None
    assert wire.receive(0.001) is None
    far.send(struct.pack("=IB3x8s", can_id, len(data), data))
    assert wire.receive(0.1) == (can_id, data)
    assert wire.receive(0.0) is None


def test_a_full_raw_socket_raises_at_once(packets):
    wire = RawWire(packets[0])
    with pytest.raises(OSError, match="unavailable"):
        wire.send([(0x201, bytes(8))] * 100_000)


def test_a_stream_is_written_as_python_can_writes_it(stream):
    near, far = stream
    StreamWire(near).send(FRAMES)
    sent = [text + b">" for text in far.recv(4096).split(b">")[:-1]]
    for (can_id, data), text in zip(FRAMES, sent, strict=True):
        extended, number = bool(can_id & EXTENDED), can_id & 0x1FFFFFFF
        message = can.Message(arbitration_id=number, data=data, is_extended_id=extended)
        assert len(text.split()[2]) == (8 if extended else 3)
        theirs = convert_can_message_to_ascii_message(message).split()
        ours = text.decode().split()
        assert ours[:2] == theirs[:2] == ["<", "send"]
        assert [int(word, 16) for word in ours[2:-1]] == [int(word, 16) for word in theirs[2:-1]]


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        (b"< frame 181 23.424242 27026400E803000A >", (0x181, TPDO)),
        (b"< frame 080 1.0  >", (0x080, b"")),
        (b"< frame 00000181 1.0 27 >", (0x181 | EXTENDED, b"\x27")),
        (b"< error 040 1.0 >", (0x40 | ERROR, b"")),
        (b"< error 20000040 1.0 >", (0x40 | ERROR, b"")),
        (b"< ok >< frame 181 1.0 27 >", (0x181, b"\x27")),
        (b"3A >< frame 181 1.0 27 >", (0x181, b"\x27")),
    ],
)
def test_stream_frames_are_read(stream, text, frame):
    near, far = stream
    wire = StreamWire(near)
    far.sendall(text)
    assert wire.receive(0.1) == frame
    assert wire.receive(0.0) is None


@pytest.mark.parametrize(
    "text",
    [
        b"< frame FFFFFFFFF 1.0 00 >",  # 36 bits
        b"< frame 20000000 1.0 00 >",
        b"< frame FFFFFFFF 1.0 00 >",
        b"< frame 800 1.0 00 >",
        b"< frame 0181 1.0 00 >",
        b"< frame 81 1.0 00 >",
        b"< frame 181 1.0 001122334455667788 >",
        b"< frame 181 1.0 0 >",
        b"< error FFFFFFFFF 1.0 >",
        b"< frame 181 1.0 %s >" % (b"00" * 8000),
    ],
)
def test_an_impossible_frame_is_skipped(stream, text):
    near, far = stream
    wire = StreamWire(near)
    far.sendall(text + b"< frame 1FFFFFFF 1.0 0011223344556677 >")
    assert wire.receive(0.1) == (0x1FFFFFFF | EXTENDED, bytes.fromhex("0011223344556677"))
    assert wire.receive(0.0) is None


WORD = st.sampled_from([b"frame", b"error", b"send", b"<", b">", b"", b"ok"])
DIGITS = st.integers(0, 1 << 40).map(lambda n: b"%03X" % n) | st.binary(max_size=4)


@given(parts=st.lists(st.tuples(WORD, DIGITS, DIGITS, DIGITS), max_size=10))
@example(parts=[(b"frame", b"FFFFFFFFF", b"1.0", b"00")])
def test_whatever_a_server_says_is_a_frame_that_can_be_kept(parts):
    """In the black box's ring, and as a message of python-can."""
    with pair(socket.SOCK_STREAM) as (near, far):
        wire = StreamWire(near)
        far.sendall(b"".join(b"< %s %s %s %s >" % part for part in parts) + b"\n>")
        while (frame := wire.receive(0.0)) is not None:
            assert_is_possible(frame)


def assert_is_possible(frame):
    can_id, data = frame
    identifier = can_id & IDENTIFIER
    assert can_id == identifier | (can_id & (EXTENDED | REMOTE | ERROR))
    assert can_id & (EXTENDED | ERROR) or identifier <= 0x7FF
    assert len(data) <= 8


def test_half_a_frame_does_not_end_a_receive(stream):
    near, far = stream
    wire = StreamWire(near)
    far.sendall(b"< ok >< frame 181 1.0 27")
    later = threading.Timer(0.02, far.sendall, (b"02 >",))
    later.start()
    assert wire.receive(5.0) == (0x181, b"\x27\x02")
    later.join()


def texts(frames: list[tuple[int, bytes]]) -> bytes:
    return b"".join(b"< frame %03X 1.5 %s >" % (i, d.hex().encode()) for i, d in frames)


@given(
    frames=st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=20),
    cuts=st.lists(st.integers(0, 600), max_size=5),
)
def test_frames_survive_being_cut(frames, cuts):
    with pair(socket.SOCK_STREAM) as (near, far):
        wire, text, got, start = StreamWire(near), texts(frames), [], 0
        for cut in [*sorted(cuts), len(text)]:
            far.sendall(text[start:cut])
            start = max(start, cut)
            while (frame := wire.receive(0.0)) is not None:
                got.append(frame)
        assert got == frames


@given(text=st.binary(max_size=400))
def test_any_text_is_skipped_without_an_exception(text):
    with pair(socket.SOCK_STREAM) as (near, far):
        wire = StreamWire(near)
        far.sendall(text + b"\n>")
        while wire.receive(0.0) is not None:
            pass
        far.sendall(b"< frame 181 1.0 27 >")
        assert wire.receive(0.1) == (0x181, b"\x27")


def test_the_end_of_a_stream_raises(stream):
    near, far = stream
    far.close()
    with pytest.raises(ConnectionError, match="closed the connection"):
        StreamWire(near).receive(0.1)


def test_a_peer_that_does_not_read_raises_at_once(stream):
    near, far = stream
    wire = StreamWire(near)
    with pytest.raises(OSError, match=r"unavailable|does not keep up"):
        wire.send([(0x201, bytes(8))] * 100_000)
    far.settimeout(1.0)
    received = b""
    while chunk := far.recv(1 << 20) if len(received) < 1_000 else b"":
        received += chunk
    assert received.startswith(b"< send 201 8 00 00")


@pytest.mark.parametrize("make", [MessageWire, QueueWire])
def test_a_bus_of_python_can(wire, make):
    bus, other_end = wire
    here, there = make(bus), make(other_end)
    assert here.receive(0.0) is None
    assert here.receive(0.001) is None
    here.send(FRAMES)
    assert [there.receive(0.0) for _ in range(5)] == [*FRAMES, None]
    for flag, kind in (
        (EXTENDED, {"is_extended_id": True}),
        (REMOTE, {"is_remote_frame": True, "is_extended_id": False}),
        (ERROR, {"is_error_frame": True, "is_extended_id": False}),
    ):
        other_end.send(can.Message(arbitration_id=0x181, **kind))
        assert here.receive(0.1) == (0x181 | flag, b"")
    bus.shutdown()
    with pytest.raises(can.CanError, match="closed bus"):
        here.send(FRAMES)
    with pytest.raises(can.CanError, match="closed bus"):
        here.receive(0.0)


def test_a_frame_sent_on_a_virtual_bus_is_a_copy(wire):
    bus, other_end = wire
    here = QueueWire(bus)
    setpoint = bytearray(b"\x0f\x00")
    here.send([(0x201, setpoint)])
    setpoint[:] = b"\x06\x00"
    message = other_end.recv(0.0)
    assert message.data == b"\x0f\x00", "what was sent is not written to any more"
    assert not message.is_extended_id


def test_a_frame_on_a_virtual_bus_ends_a_receive(wire):
    bus, other_end = wire
    sender = threading.Timer(0.02, lambda: other_end.send(can.Message(arbitration_id=1)))
    sender.start()
    assert QueueWire(bus).receive(10.0) == (1 | EXTENDED, b"")
    sender.join()


def test_a_virtual_bus_that_is_not_read_raises_at_once():
    with (
        can.Bus(interface="virtual", channel="full") as near,
        can.Bus(interface="virtual", channel="full", rx_queue_size=2),
        pytest.raises(can.CanError, match="does not keep up"),
    ):
        QueueWire(near).send(FRAMES)
