"""Turns of SDO and tick on one bus: whatever comes while they change is heard once, and at once."""

import os
import socket
import threading
import tty
from collections.abc import Callable, Iterator

import pytest

from common.errors import BusError
from drivers.can.slcan import SlcanWire
from drivers.can.socketcand import StreamWire
from drivers.can.wire import Frame, Wire
from drivers.canopen.boot.boot_up import DriveBoot
from drivers.canopen.boot.received_frames import ReceivedFrames
from drivers.canopen.boot.sdo_network import sdo_network

Say = Callable[[bytes], object]


def socketcand_text(frame: Frame) -> bytes:
    return b"< frame %03X 1.0 %s >" % (frame[0], frame[1].hex().encode())


def slcan_text(frame: Frame) -> bytes:
    return b"t%03X%d%s\r" % (frame[0], len(frame[1]), frame[1].hex().encode())


@pytest.fixture(params=["socketcand", "slcan"])
def text_line(request) -> Iterator[tuple[Wire, Say, Callable[[Frame], bytes]]]:
    """A wire, what puts text on the other end of its line, and the text of a frame."""
    if request.param == "socketcand":
        near, far = socket.socketpair()
        with near, far:
            yield StreamWire(near), far.sendall, socketcand_text
        return
    adapter, ours = os.openpty()
    tty.setraw(adapter)
    tty.setraw(ours)
    os.set_blocking(ours, False)
    yield SlcanWire(ours), lambda text: os.write(adapter, text), slcan_text
    os.close(adapter)
    os.close(ours)


class Heard(ReceivedFrames):
    """Reader that also says when something has come."""

    def __init__(self) -> None:
        super().__init__()
        self.news = threading.Event()

    def put(self, frame: Frame) -> None:
        super().put(frame)
        self.news.set()


ONE, TWO, THREE = [(0x700 + node, b"\x05") for node in (1, 2, 3)]


def test_a_frame_that_is_cut_when_the_tick_takes_over(text_line):
    wire, say, text = text_line
    for cut in range(1, len(text(TWO))):
        heard = Heard()
        with sdo_network(wire, received=heard):
            say(text(ONE) + text(TWO)[:cut])
            assert heard.news.wait(5.0)
        assert heard.take() == [ONE]
        say(text(TWO)[cut:] + text(THREE))
        assert [wire.receive(5.0), wire.receive(5.0)] == [TWO, THREE], cut


def test_a_frame_that_is_cut_when_sdo_takes_over(text_line):
    wire, say, text = text_line
    for cut in range(1, len(text(TWO))):
        say(text(ONE) + text(TWO)[:cut])
        assert wire.receive(5.0) == ONE
        heard = Heard()
        with sdo_network(wire, received=heard):
            say(text(TWO)[cut:])
            assert heard.news.wait(5.0)
        assert heard.take() == [TWO], cut


def test_what_is_unread_when_sdo_ends_is_the_ticks_at_once(text_line):
    wire, say, text = text_line
    frames = [(0x80 + node, bytes(8)) for node in range(1, 8)]
    heard, go_on = Heard(), threading.Event()
    with sdo_network(wire, received=heard) as network:
        network.subscribe(frames[0][0], lambda *_: go_on.wait(5.0))
        say(b"".join(text(frame) for frame in frames))
        assert heard.news.wait(5.0)
        # The reader has all seven, and is asked to end before it hands the second out.
        network._ended.set()
        go_on.set()
    assert heard.take() == frames[:1]
    assert [wire.receive(5.0) for _ in frames[1:]] == frames[1:]
    with sdo_network(wire, received=heard):
        heard.news.clear()
        say(text(THREE))
        assert heard.news.wait(5.0)
    assert heard.take() == [THREE], "and nothing a second time"


def test_what_the_tick_has_not_read_is_heard(text_line):
    wire, say, text = text_line
    say(text(ONE) + text(TWO))
    assert wire.receive(5.0) == ONE
    heard = Heard()
    with sdo_network(wire, received=heard):
        assert heard.news.wait(5.0)
    assert heard.take() == [TWO]


class Breaking:
    """A wire that breaks at the first frame that is sent."""

    def __init__(self, error: Exception) -> None:
        self._error, self._sent = error, threading.Event()

    def receive(self, timeout: float) -> Frame | None:
        if self._sent.wait(timeout):
            raise self._error
        return None

    def send(self, frames) -> None:
        self._sent.set()


@pytest.mark.parametrize("error", [ConnectionError("peer is gone"), IndexError("a program error")])
def test_a_reader_that_fails_is_no_drives_fault(setups, error, capfd):
    boot = DriveBoot(Breaking(error), setups, 10, listen_s=0.0)
    with pytest.raises(BusError, match=f"can no longer be read: {error}"):
        boot.boot_up()
    assert capfd.readouterr() == ("", "")


def test_a_reader_that_fails_while_no_one_waits_is_reported_at_the_end():
    wire = Breaking(ConnectionError("peer is gone"))
    wire.send([])
    with pytest.raises(BusError, match="peer is gone"), sdo_network(wire) as network:
        network._reader.join(5.0)


def test_what_went_wrong_in_the_block_is_what_is_reported():
    def fail(network):
        network._reader.join(5.0)
        raise LookupError

    wire = Breaking(ConnectionError("peer is gone"))
    wire.send([])
    with pytest.raises(LookupError), sdo_network(wire) as network:
        fail(network)


def test_an_identifier_of_29_bits_is_no_answer():
    near, far = socket.socketpair()
    answers, came = [], threading.Event()
    with near, far, sdo_network(StreamWire(near)) as network:
        network.subscribe(0x583, lambda _, data, __: (answers.append(data[0]), came.set()))
        far.sendall(b"< frame 00000583 1.0 40 >< frame 583 1.0 60 >")
        assert came.wait(5.0)
    assert answers == [0x60]
