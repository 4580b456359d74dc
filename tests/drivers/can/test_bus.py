"""Opening the bus, and noticing that it is gone."""

import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import get_args

import pytest

from bench.rigs.lines import LINES
from common.errors import BusError
from drivers.can.bus import BUS_FAILURES, INTERFACES, open_bus
from drivers.can.settings import BusSettings, Interface
from drivers.can.wire import OpenBus


@contextmanager
def peer(replies: list[bytes]) -> Iterator[tuple[int, list[socket.socket]]]:
    """A TCP server that greets, and answers what it reads with the replies, one after the other."""
    listener = socket.create_server(("127.0.0.1", 0))
    connections: list[socket.socket] = []

    def converse(connection: socket.socket) -> None:
        connection.sendall(replies[0])
        for reply in replies[1:]:
            if not connection.recv(256):
                return
            connection.sendall(reply)

    def accept() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            connections.append(connection)
            try:
                converse(connection)
            except OSError:
                continue

    thread = threading.Thread(target=accept)
    thread.start()
    try:
        yield listener.getsockname()[1], connections
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join()
        for connection in connections:
            connection.close()


def socketcand(port: int) -> BusSettings:
    return BusSettings(interface="socketcand", channel="can0", port=port)


SOCKETCAND = [b"< hi >", b"< ok >", b"< ok >"]


def test_an_interface_that_is_not_there():
    with pytest.raises(BusError, match=r"no interface 'can77'.*ip link"):
        open_bus(BusSettings(interface="socketcan", channel="can77"))


def test_an_interface_without_can():
    with pytest.raises(BusError, match="bus socketcan lo"):
        open_bus(BusSettings(interface="socketcan", channel="lo"))


def test_no_one_listens():
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        port = server.getsockname()[1]
    with pytest.raises(BusError, match=rf"127.0.0.1:{port}; is `contactd simulate` running"):
        open_bus(socketcand(port))


def test_another_listens():
    refused = pytest.raises(BusError, match="is no socketcand server")
    with peer([b"SSH-2.0-OpenSSH"]) as (port, _), refused:
        open_bus(socketcand(port))


def test_a_bus_that_is_not_served():
    refused = pytest.raises(BusError, match=r"does not open 'can0': .*could not open bus")
    with peer([b"< hi >", b"< error could not open bus >"]) as (port, _), refused:
        open_bus(socketcand(port))


def test_a_serial_adapter_that_is_not_there():
    with pytest.raises(BusError, match="bus slcan /dev/nosuchadapter"):
        open_bus(BusSettings(interface="slcan", channel="/dev/nosuchadapter"))


def test_the_end_of_the_connection_is_noticed_after_the_last_frame():
    with peer(SOCKETCAND) as (port, connections), closing_bus(open_bus(socketcand(port))) as opened:
        connections[-1].sendall(b"< frame 181 1.0 2700 >")
        connections[-1].close()
        assert opened.wire.receive(5.0) == (0x181, b"\x27\x00")
        with pytest.raises(BUS_FAILURES, match="closed the connection"):
            opened.wire.receive(5.0)


def test_a_python_can_that_hides_its_connection_elsewhere_is_said_so(monkeypatch):
    class Elsewhere:
        def shutdown(self) -> None:
            pass

    monkeypatch.setattr("can.Bus", lambda **_: Elsewhere())
    with peer(SOCKETCAND) as (port, _), pytest.raises(BusError, match="does not expose its socket"):
        open_bus(socketcand(port))


@contextmanager
def closing_bus(opened: OpenBus) -> Iterator[OpenBus]:
    try:
        yield opened
    finally:
        opened.python_can.shutdown()


def test_virtual():
    with closing_bus(open_bus(BusSettings(interface="virtual", channel="drivers-open"))) as opened:
        assert opened.wire.receive(0.0) is None


def test_every_interface_is_opened_and_tried():
    names = set(get_args(Interface))
    assert INTERFACES.keys() == names
    assert names - {"socketcan"} == LINES.keys() - {"socketcan"}, "faults are tried on each"
