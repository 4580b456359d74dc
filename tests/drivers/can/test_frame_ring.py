"""The last frames, in memory that outlives its writer."""

import os
import signal
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import LogError
from drivers.can.frame_ring import FrameRing, RecordedWire, read_frames
from drivers.can.virtual import QueueWire
from drivers.can.wire import ERROR, EXTENDED
from tests.examples import scaled

FRAME = st.tuples(
    st.sampled_from([0x000, 0x181, 0x77F, 0x12345 | EXTENDED, 0x40 | ERROR]),
    st.binary(max_size=8),
    st.booleans(),
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "frames"


@settings(max_examples=scaled(30))
@given(frames=st.lists(FRAME, max_size=20), capacity=st.integers(1, 12))
def test_the_last_ones_are_kept_in_order(tmp_path_factory, frames, capacity):
    path = tmp_path_factory.mktemp("ring") / "frames"
    ring = FrameRing(path, capacity, lambda: 0.0)
    for k, (can_id, data, sent) in enumerate(frames):
        ring.put(float(k), can_id, data, sent)
    kept = read_frames(path)
    assert [(f.can_id, f.data, f.sent) for f in kept] == frames[-capacity:]
    assert [f.time_s - kept[0].time_s for f in kept] == pytest.approx(range(len(kept)), abs=1e-6)
    ring.close()


def test_more_than_a_frame_holds_is_cut(path):
    ring = FrameRing(path, 2, lambda: 0.0)
    ring.put(0.0, 0x181, bytes(range(12)), False)
    assert read_frames(path)[0].data == bytes(range(8))
    ring.close()


def test_times_are_of_the_day(path):
    ring = FrameRing(path, 2, lambda: 1000.0)
    ring.put(1000.0, 0x181, b"", False)
    assert read_frames(path)[0].time_s == pytest.approx(os.stat(path).st_mtime, abs=5.0)
    ring.close()


def test_a_record_that_is_torn_is_left_out(path):
    ring = FrameRing(path, 4, lambda: 0.0)
    for k in (1.0, 0.5, 2.0):
        ring.put(k, int(10 * k), b"", False)
    assert [frame.can_id for frame in read_frames(path)] == [10, 20]
    ring.close()


@pytest.mark.parametrize("content", [b"", b"nonsense" * 20, b"contactd" + bytes(100)])
def test_another_file_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(LogError, match=r"frames: .*frame ring"):
        read_frames(path)


def test_no_file(path):
    with pytest.raises(LogError, match="No such file"):
        read_frames(path)


def test_what_was_written_survives_kill_9(path):
    program = (
        "import os, signal, sys; from pathlib import Path\n"
        "from drivers.can.frame_ring import FrameRing\n"
        "ring = FrameRing(Path(sys.argv[1]), 100, lambda: 0.0)\n"
        "for k in range(250): ring.put(k, k, b'abc', True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert [frame.can_id for frame in read_frames(path)] == list(range(150, 250))


def test_both_directions_of_a_wire(wire, path):
    ring = FrameRing(path, 10, lambda: 0.0)
    here, there = RecordedWire(QueueWire(wire[0]), ring), QueueWire(wire[1])
    here.send([(0x080, b""), (0x201, bytearray(b"\x0f\x00"))])
    there.send([(0x181, b"\x27")])
    assert here.receive(0.1) == (0x181, b"\x27")
    assert here.receive(0.0) is None
    assert [(f.can_id, f.data, f.sent) for f in read_frames(path)] == [
        (0x080, b"", True),
        (0x201, b"\x0f\x00", True),
        (0x181, b"\x27", False),
    ]
    ring.close()


def test_what_the_bus_refuses_was_not_sent(wire, path):
    ring = FrameRing(path, 10, lambda: 0.0)
    here = RecordedWire(QueueWire(wire[0]), ring)
    wire[0].shutdown()
    with pytest.raises(Exception, match="closed bus"):
        here.send([(0x080, b"")])
    assert read_frames(path) == []
    ring.close()
