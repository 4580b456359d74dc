"""Messages to systemd, on sockets of our own; time is made up."""

import contextlib
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from common.errors import DriveError
from daemon.service.notify import Notifier, failure_reported, notifier_of

T = 0.01
Connect = Callable[..., Notifier]


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[socket.socket]:
    """A receiving socket; `address_of` gives its name as in $NOTIFY_SOCKET."""
    name = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as receiver:
        receiver.bind("\0" + name if request.param == "abstract" else name)
        yield receiver


@pytest.fixture
def connect() -> Iterator[Connect]:
    """Makes Notifiers, and closes them after the test."""
    with contextlib.ExitStack() as stack:
        yield lambda *given, **named: stack.enter_context(closing(Notifier(*given, **named)))


def address_of(manager: socket.socket) -> str:
    name = manager.getsockname()
    return f"@{name[1:].decode()}" if isinstance(name, bytes) else str(name)


def received(manager: socket.socket) -> list[bytes]:
    messages = []
    while True:
        try:
            messages.append(manager.recv(4096))
        except BlockingIOError:
            return messages


def test_a_reload_lengthens_the_watchdogs_timeout(manager: socket.socket, connect: Connect) -> None:
    notifier = connect(address_of(manager), 2.0)
    notifier.ready("off")
    notifier.reloading("reading", 12.5)
    notifier.ready("off")
    assert received(manager) == [
        b"READY=1\nWATCHDOG_USEC=2000000\nSTATUS=off",
        b"RELOADING=1\nMONOTONIC_USEC=12500000\nWATCHDOG_USEC=60000000\nSTATUS=reading",
        b"READY=1\nWATCHDOG_USEC=2000000\nSTATUS=off",
    ]


def test_ready_status_and_stopping(manager: socket.socket, connect: Connect) -> None:
    notifier = connect(address_of(manager))
    notifier.ready("off, not armed")
    notifier.status("holding: enable\nMAINPID=1")
    notifier.stopping("SIGTERM")
    assert received(manager) == [
        b"READY=1\nSTATUS=off, not armed",
        b"STATUS=holding: enable MAINPID=1",
        b"STOPPING=1\nSTATUS=SIGTERM",
    ]


def test_ticks_feed_the_watchdog_in_time(manager: socket.socket, connect: Connect) -> None:
    notifier = connect(address_of(manager), watchdog_s=0.4)
    notifier.ready("")
    received(manager)
    fed = []
    for k in range(1001):  # ten seconds
        notifier.ticked(500.0 + k * T)
        fed += received(manager)
    assert set(fed) == {b"WATCHDOG=1"}
    assert 90 < len(fed) <= 101
    # No tick, no food; the first tick after a pause feeds at once, and only once.
    assert received(manager) == []
    notifier.ticked(600.0)
    notifier.ticked(600.0 + T)
    assert received(manager) == [b"WATCHDOG=1"]


def test_ticks_send_nothing_without_a_watchdog(manager: socket.socket, connect: Connect) -> None:
    notifier = connect(address_of(manager))
    for k in range(100):
        notifier.ticked(k * T)
    assert received(manager) == []


def test_a_full_socket_is_never_waited_for(
    manager: socket.socket, connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    notifier = connect(address_of(manager), watchdog_s=4 * T)
    sent = 0
    while not caplog.records:  # a datagram socket of Linux holds some ten messages
        notifier.ticked(sent * 10 * T)
        sent += 1
        assert sent < 10_000
    for k in range(100):
        notifier.status(f"status {k}")
        notifier.ticked((sent + k) * 10 * T)
    assert len(caplog.records) == 1  # reported once, not every tick
    received(manager)
    notifier.ticked(2000.0)
    # Of the lines that did not get through only the last is still true; the watchdog is fed.
    assert received(manager) == [b"STATUS=status 99", b"WATCHDOG=1"]
    notifier.ticked(2000.0 + T)
    assert received(manager) == []


def test_ready_is_sent_again_after_a_full_socket(manager: socket.socket, connect: Connect) -> None:
    other = connect(address_of(manager))
    for k in range(1000):
        other.status(str(k))
    notifier = connect(address_of(manager))
    notifier.ready("off")
    notifier.status("enabling")
    received(manager)
    notifier.ticked(1.0)
    assert received(manager) == [b"READY=1\nSTATUS=enabling"]


@pytest.mark.parametrize("address", ["", "vsock:2:1234", "/nowhere/at/all", "@contactd-absent"])
def test_without_a_manager_nothing_happens(address: str, connect: Connect) -> None:
    notifier = connect(address, watchdog_s=1.0)
    notifier.ready("")
    notifier.ticked(0.0)


@pytest.mark.parametrize(
    ("environment", "feed_every_s"),
    [
        ({}, 0.0),
        ({"WATCHDOG_USEC": "2000000"}, 0.5),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())}, 0.5),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}, 0.0),  # meant for another process
        ({"WATCHDOG_USEC": "soon"}, 0.0),
    ],
)
def test_the_timeout_of_the_environment(environment: dict[str, str], feed_every_s: float) -> None:
    with closing(notifier_of(environment, os.getpid())) as notifier:
        assert notifier.feed_every_s == feed_every_s


def test_an_error_that_ends_the_process_is_its_status(manager: socket.socket) -> None:
    there = {"NOTIFY_SOCKET": address_of(manager)}
    with pytest.raises(DriveError), failure_reported(there, os.getpid()):
        raise DriveError("LElbowRoll (node 3):\ndoes not answer")
    with pytest.raises(ZeroDivisionError), failure_reported(there, os.getpid()):
        raise ZeroDivisionError
    with failure_reported(there, os.getpid()):
        pass
    assert received(manager) == [
        b"STATUS=failed: LElbowRoll (node 3): does not answer",
        b"STATUS=failed: ZeroDivisionError",
    ]
