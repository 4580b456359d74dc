"""The CAN bus as the configuration names it: opening it, emptying it, noticing that it is gone."""

import logging
import socket
from pathlib import Path
from typing import Final

import can

from drivers.settings import BusSettings
from errors import BusError

#: What python-can's interfaces raise when a bus is closed, down or full: not only its own errors.
BUS_FAILURES: Final = (can.CanError, OSError, ValueError)

_IFF_UP = 0x1
_CONNECT_TIMEOUT_S = 2.0


def open_bus(settings: BusSettings) -> can.BusABC:
    """Open the bus; raises BusError with what to do about it."""
    try:
        if settings.interface == "socketcan":
            _refuse_missing_interface(settings)
            return can.Bus(interface="socketcan", channel=settings.channel)
        if settings.interface == "socketcand":
            return _open_socketcand(settings)
        if settings.interface == "slcan":
            return can.Bus(interface="slcan", channel=settings.channel, bitrate=settings.bitrate)
        return can.Bus(interface="virtual", channel=settings.channel)
    except (*BUS_FAILURES, ImportError) as error:
        raise BusError(f"bus {settings.interface} {settings.channel}: {error}") from error


def _refuse_missing_interface(settings: BusSettings) -> None:
    if not hasattr(socket, "AF_CAN"):
        raise BusError("bus socketcan: this Python was built without CAN sockets")
    flags = Path("/sys/class/net", settings.channel, "flags")
    if not flags.exists():
        raise BusError(
            f"bus socketcan: no interface {settings.channel!r}; `ip link` lists those there are"
        )
    if not int(flags.read_text(), 16) & _IFF_UP:
        raise BusError(
            f"bus socketcan: interface {settings.channel!r} is down; `ip link set "
            f"{settings.channel} up type can bitrate {settings.bitrate}` brings it up"
        )


def _open_socketcand(settings: BusSettings) -> can.BusABC:
    where = f"{settings.host}:{settings.port}"
    # python-can would retry a refused connection for ten seconds, wait for a greeting for ever, and
    # leave its socket open after a refusal; so a connection of our own tries first.
    try:
        with socket.create_connection((settings.host, settings.port), _CONNECT_TIMEOUT_S) as probe:
            greeting = probe.recv(64)
            if greeting != b"< hi >":
                raise BusError(f"bus socketcand: {where} answers, but not as socketcand does")
            probe.sendall(f"< open {settings.channel} >".encode())
            answer = probe.recv(256)
            if answer != b"< ok >":
                words = answer.decode(errors="replace")
                raise BusError(f"bus socketcand: {where} opens no {settings.channel!r}: {words!r}")
    except ConnectionRefusedError as error:
        raise BusError(
            f"bus socketcand: nothing listens on {where}; is `contactd simulate` running?"
        ) from error
    except OSError as error:
        raise BusError(f"bus socketcand: {where}: {error}") from error
    # A frame cut in two by TCP is no news, but python-can warns of each.
    logging.getLogger("can.interfaces.socketcand").setLevel(logging.ERROR)
    return can.Bus(
        interface="socketcand",
        host=settings.host,
        port=settings.port,
        channel=settings.channel,
        tcp_tune=True,
    )


def socketcand_socket(bus: can.BusABC) -> socket.socket | None:
    """The TCP connection of a `socketcand` bus, which python-can keeps to itself; else None."""
    found = getattr(bus, "_SocketCanDaemonBus__socket", None)
    return found if isinstance(found, socket.socket) else None


def connection_lost(bus: can.BusABC) -> bool:
    """Whether the TCP peer of a `socketcand` bus is gone; False on any other bus.

    python-can answers end-of-file with "no frame" for ever, so its socket is asked itself, without
    waiting and without taking anything from it.
    """
    peer = socketcand_socket(bus)
    if peer is None:
        return False
    try:
        return peer.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True
