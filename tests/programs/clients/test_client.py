"""Client of contactd's own types. Its connection is that of `test_contactd_client`."""

import os
import socket
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from common.errors import ControlError, UnreachableError
from daemon.protocol.replies import Reply
from daemon.protocol.state import State
from programs.clients.client import Client
from tests.fake_daemon import state_at


def test_requests_are_answered(fake_daemon: Any) -> None:
    with Client(fake_daemon.path) as client:
        assert client.request("enable").message == "enable done"
        status = client.request("status").status
        assert status is not None
        assert status.pid == 4711
    (command, peer), _ = fake_daemon.seen
    assert (command, peer.uid, peer.pid) == ("enable", os.getuid(), os.getpid())


def test_a_demand_raises_with_every_reason(fake_daemon: Any) -> None:
    fake_daemon.refusals |= {"arm": ["too early", "too late"], "status": ["never"]}
    fake_daemon.refusals["subscribe"] = ["not now"]
    with Client(fake_daemon.path) as client:
        assert client.demand("enable").message == "enable done"
        with pytest.raises(ControlError, match=r"^arm is refused; too early; too late$"):
            client.demand("arm")
        with pytest.raises(ControlError, match=r"^status is refused; never$"):
            client.ask_status()
        with pytest.raises(ControlError, match=r"^subscribe is refused; not now$"):
            client.subscribe()
        del fake_daemon.refusals["status"]
        assert client.ask_status().pid == 4711
    assert Reply(ok=False, reasons=["why"]).refusal == "refused; why"


def test_states_keep_every_bit(fake_daemon: Any) -> None:
    with Client(fake_daemon.path) as client:
        snapshot, states = client.subscribe()
        taken = list(islice(states, 20))
    assert snapshot.tick == snapshot.memory["tick"]
    assert taken[0].tick == snapshot.tick + 1
    for state in taken:
        assert state == state_at(state.tick)


def test_a_socket_without_a_daemon_is_reported(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as dead:
        dead.bind(str(tmp_path / "control"))
    with pytest.raises(UnreachableError, match="no contactd serves"):
        Client(tmp_path / "control")


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ("contact", "join the group contact (sudo usermod -aG contact YOU; it counts from your"),
        ("root", "it belongs to the group root. Create the group contact, add yourself, and start"),
        (KeyError(), "it belongs to the group {}. Create the group contact, add yourself, and"),
        (PermissionError(), "you have no access to its folder"),
    ],
)
def test_a_refused_socket_is_reported_with_the_group_to_join(
    fake_daemon: Any, monkeypatch: pytest.MonkeyPatch, group: str | Exception, words: str
) -> None:
    def denied(self: socket.socket, address: str) -> None:
        raise PermissionError(13, "Permission denied")

    def group_of(self: Path) -> str:
        if isinstance(group, Exception):
            raise group
        return group

    monkeypatch.setattr(socket.socket, "connect", denied)
    monkeypatch.setattr(Path, "group", group_of)
    with pytest.raises(UnreachableError) as caught:
        Client(fake_daemon.path)
    words = words.format(fake_daemon.path.stat().st_gid)
    assert str(caught.value).startswith(f"you may not use {fake_daemon.path}: {words}")
    assert "usermod -aG root" not in str(caught.value)


def test_a_daemon_that_never_accepts_is_reported_busy(listener: socket.socket) -> None:
    path = Path(listener.getsockname())
    listener.listen(1)
    with (
        Client(path),
        Client(path),  # one more than the backlog, by the kernel's count
        pytest.raises(UnreachableError, match="busy"),
    ):
        Client(path, timeout_s=0.05)


def test_an_answer_sent_before_the_request_is_read(listener: socket.socket) -> None:
    with Client(Path(listener.getsockname())) as client:
        accepted, _ = listener.accept()
        with accepted:
            accepted.send(b'{"ok": false, "message": "full"}')
        assert client.request("stop").message == "full"


def test_a_connection_closed_to_make_room_is_reported_so(fake_daemon: Any) -> None:
    first = Client(fake_daemon.path)
    first.request("status")
    held = [first, *(Client(fake_daemon.path) for _ in range(256))]
    held[-1].request("status")
    reply = first.request("stop")
    assert not reply.ok
    assert "closed to make room: more than 256 connections" in reply.message
    with Client(fake_daemon.path) as late:
        assert late.request("stop").ok
    for client in held:
        client.close()


def test_a_stream_that_stops_is_reported(fake_daemon: Any) -> None:
    end = fake_daemon.tick + 200
    fake_daemon.states = lambda tick: state_at(tick) if tick < end else None
    with Client(fake_daemon.path, timeout_s=0.2) as client:
        _, states = client.subscribe()
        taken: list[State] = []
        with pytest.raises(UnreachableError, match="the daemon fell silent"):
            taken.extend(states)
    # A reader that is too slow misses States, but gets none twice, nor in another order.
    ticks = [state.tick for state in taken]
    assert ticks
    assert ticks == sorted(set(ticks))
    assert ticks[-1] < end


@pytest.mark.parametrize("packet", [b"hello", b"[]", b'{"message": "no ok"}', b"\xff"])
def test_an_answer_of_another_version_is_refused(listener: socket.socket, packet: bytes) -> None:
    with Client(Path(listener.getsockname())) as client:
        accepted, _ = listener.accept()
        with accepted:
            accepted.send(packet)
            with pytest.raises(ControlError, match="another version"):
                client.request("status")
