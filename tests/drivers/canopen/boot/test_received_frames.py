"""Frames that come while drives are set up: each once, the last of each last, within bounds."""

import pytest

from drivers.can.wire import ERROR
from drivers.canopen.boot import received_frames
from drivers.canopen.boot.received_frames import ReceivedFrames


def hear(received, *frames):
    for cob_id, data in frames:
        received.put((cob_id, data))


@pytest.mark.parametrize(
    ("came", "kept"), [("AAA", "A"), ("ABA", "BA"), ("AB", "AB"), ("ABAB", "AB")]
)
def test_what_came_last_is_last(came, kept):
    received = ReceivedFrames()
    hear(received, *((0x701, letter.encode()) for letter in came))
    assert b"".join(data for _, data in received.take()).decode() == kept
    assert received.take() == []


@pytest.mark.parametrize("cob_id", [0x183, 0x283, 0x383, 0x483, 0x583])
def test_answers_to_sdo_and_sync_are_not_kept(cob_id):
    received = ReceivedFrames()
    hear(received, (cob_id, b"1"), (0x203, b"2"), (0x603, b"3"), (0x80, b""), (0x0, b"\1\2"))
    assert [can_id for can_id, _ in received.take()] == [0x203, 0x603, 0x80, 0x0]


def test_there_is_an_end_to_it(monkeypatch):
    monkeypatch.setattr(received_frames, "MOST", 3)
    received = ReceivedFrames()
    hear(received, *((0x83, bytes([k])) for k in range(5)), (0x83, b"\0"))
    assert [data for _, data in received.take()] == [b"\1", b"\2", b"\0"]


def test_an_error_frame_stays_one():
    received = ReceivedFrames()
    received.put((0x40 | ERROR, bytes(8)))
    assert received.take()[0][0] & ERROR
