"""slcan: a line of text per frame, over a pseudo-terminal in place of an adapter."""

import os
import select
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import suppress

import can
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from common.errors import BusError
from drivers.can.bus import BUS_FAILURES, open_bus
from drivers.can.settings import BusSettings
from drivers.can.slcan import SlcanWire
from drivers.can.wire import EXTENDED, IDENTIFIER, REMOTE
from tests.examples import scaled


@pytest.fixture
def line() -> Iterator[tuple[int, int]]:
    """The adapter's end of a serial line, and ours, which does not wait."""
    adapter, ours = os.openpty()
    tty.setraw(adapter)
    tty.setraw(ours)
    os.set_blocking(ours, False)
    yield adapter, ours
    for end in (adapter, ours):
        with suppress(OSError):
            os.close(end)


def read_until(adapter: int, end: bytes) -> bytes:
    """The line hands on piece by piece what is written."""
    said = b""
    while end not in said:
        said += os.read(adapter, 4096)
    return said


def test_opened_by_configuration_alone(line, monkeypatch):
    monkeypatch.setattr("can.interfaces.slcan.time.sleep", lambda _: None)
    adapter, ours = line
    settings = BusSettings(interface="slcan", channel=os.ttyname(ours), bitrate=500_000)
    opened = open_bus(settings)
    try:
        said = read_until(adapter, b"O\r")
        assert b"S6\r" in said
        assert said.endswith(b"O\r")
        wire = opened.wire
        assert isinstance(wire, SlcanWire)
        wire.send([(0x080, b""), (0x201, bytearray(b"\x0f\x00\xff"))])
        assert read_until(adapter, b"ff\r") == b"t0800\rt20130f00ff\r"
        wire.send([(0x0200FD01 | EXTENDED, b"\x27")])
        assert read_until(adapter, b"27\r") == b"T0200FD01127\r"
        os.write(adapter, b"\rz\rt18122702\r")
        assert wire.receive(0.5) == (0x181, b"\x27\x02")
        assert wire.receive(0.0) is None
    finally:
        opened.python_can.shutdown()


@pytest.mark.parametrize("word", [b"\r", b"z\r", b"\a", b"t181", b"t1819\r"])
def test_an_adapters_word_is_not_the_end_of_waiting(line, word):
    # Many acknowledge each frame that they send, SYNC too, and drives answer only then.
    adapter, ours = line
    wire = SlcanWire(ours)
    os.write(adapter, word)
    later = threading.Timer(0.02, os.write, (adapter, b"\rt18122702\r"))
    later.start()
    assert wire.receive(5.0) == (0x181, b"\x27\x02")
    later.join()
    os.write(adapter, word)
    before = time.monotonic()
    assert wire.receive(0.02) is None
    assert 0.02 <= time.monotonic() - before < 1.0


def test_no_adapter_is_said_so():
    with pytest.raises(BusError, match=r"bus slcan /dev/none: .*could not open port"):
        open_bus(BusSettings(interface="slcan", channel="/dev/none"))


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        (b"t181227ab\r", (0x181, b"\x27\xab")),
        (b"t18122702ABCD\r", (0x181, b"\x27\x02")),  # with a time stamp
        (b"T00000181127\r", (0x181 | EXTENDED, b"\x27")),
        (b"r7010\r", (0x701 | REMOTE, b"")),
        (b"tFFF0\rt8000\rTFFFFFFFF0\rT200000000\rt1810\r", (0x181, b"")),  # more than the bus has
        (b"T1FFFFFFF0\r", (0x1FFFFFFF | EXTENDED, b"")),
        (b"t\rt1\rt181\rt1819\rt1812AB\r\at1810\r", (0x181, b"")),
    ],
)
def test_lines(line, text, frame):
    adapter, ours = line
    wire = SlcanWire(ours)
    os.write(adapter, text)
    assert wire.receive(0.5) == frame
    assert wire.receive(0.0) is None


FRAMES = st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=8)


@settings(max_examples=scaled(50))
@given(frames=FRAMES, garbage=st.binary(max_size=30), cut=st.integers(0, 60))
def test_frames_survive_garbage_and_being_cut(frames, garbage, cut):
    reader, writer = os.pipe()
    os.set_blocking(reader, False)
    try:
        wire = SlcanWire(reader)
        text = b"".join(b"t%03X%d%s\r" % (i, len(d), d.hex().encode()) for i, d in frames)
        got = []
        for part in (garbage + b"\r", text[:cut], text[cut:]):
            os.write(writer, part or b"\a")
            while (frame := wire.receive(0.0)) is not None:
                got.append(frame)
        assert got[len(got) - len(frames) :] == frames
    finally:
        os.close(reader)
        os.close(writer)


LINE = st.tuples(
    st.sampled_from([b"t", b"T", b"r", b"R", b"", b"z"]),
    st.integers(0, 1 << 60).map(lambda n: b"%X" % n) | st.binary(max_size=12),
)


@settings(max_examples=scaled(200))
@given(lines=st.lists(LINE, max_size=10))
@example(lines=[(b"T", b"FFFFFFFF0"), (b"t", b"FFF0")])
def test_whatever_an_adapter_says_is_a_frame_that_a_bus_can_carry(lines):
    reader, writer = os.pipe()
    os.set_blocking(reader, False)
    try:
        wire = SlcanWire(reader)
        os.write(writer, b"".join(kind + digits + b"\r" for kind, digits in lines) + b"\r")
        while (frame := wire.receive(0.0)) is not None:
            can_id, data = frame
            assert can_id & IDENTIFIER <= (IDENTIFIER if can_id & EXTENDED else 0x7FF)
            assert can_id & ~(IDENTIFIER | EXTENDED | REMOTE) == 0
            assert len(data) <= 8
    finally:
        os.close(reader)
        os.close(writer)


def read_until_quiet(adapter, quiet_s=0.2):
    """All that comes: a terminal hands its bytes over in portions, each a little later."""
    text = b""
    while select.select([adapter], [], [], quiet_s)[0]:
        text += os.read(adapter, 65536)
    return text


def test_an_adapter_that_does_not_keep_up_is_a_failure_and_no_wait(line):
    adapter, ours = line
    wire = SlcanWire(ours)
    with pytest.raises(BUS_FAILURES):
        wire.send([(0x201, bytes(range(8))), (0x202, bytes(8))] * 10_000)
    text = read_until_quiet(adapter)
    wire.send([(0x203, b"\1")])
    text += read_until_quiet(adapter)
    whole = {b"t20180001020304050607", b"t20280000000000000000", b"t203101"}
    assert set(text.split(b"\r")[:-1]) == whole, "no frame is cut"


def test_an_adapter_that_is_unplugged_is_a_failure(line):
    adapter, ours = line
    wire = SlcanWire(ours)
    os.close(adapter)
    with pytest.raises(BUS_FAILURES):
        wire.receive(0.01)
    with pytest.raises(BUS_FAILURES):
        wire.send([(0x080, b"")])
    assert issubclass(can.CanOperationError, BUS_FAILURES)
