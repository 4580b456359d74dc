"""View socket: its clients may stop the arm, and command nothing else."""

import contextlib
import json
import os
import socket
from collections.abc import Callable, Iterator

import pytest

from bench.rigs.served_daemon import ServedDaemon
from contactd_client.paths import view_socket_path
from daemon.config.schema import frames_of
from daemon.protocol.doors import DOORS, Door, refusal
from daemon.protocol.replies import Reply
from daemon.protocol.requests import COMMANDS, Arm, Request, Stop
from daemon.protocol.state import State
from daemon.service.socket import ControlSocket
from drivers.can.load import bus_load
from programs.clients.client import Client
from tests.daemon.service.socket_rig import SocketRig, send
from tests.fake_daemon import snapshot_at
from tests.socket_peers import Dial, inside, reported


@pytest.fixture
def look(control: ControlSocket) -> Iterator[Dial]:
    """Connects to the view socket without blocking; everything is closed at the end."""
    opened: list[socket.socket] = []

    def connect() -> socket.socket:
        opened.append(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK))
        opened[-1].connect(str(view_socket_path(control.path)))
        return opened[-1]

    yield connect
    for one in opened:
        one.close()


def ask(client: socket.socket, command: str) -> None:
    target = {"q": [0.0], "sent_s": 0.0, "number": 1}
    more = {"gain": {"joint": "joint", "gain": 0.1}, "follow": target, "target": target}
    client.send(json.dumps({"command": command, **more.get(command, {})}).encode())


@pytest.mark.parametrize("command", COMMANDS)
def test_it_serves_the_listed_commands_alone(sockets: SocketRig, look: Dial, command: str) -> None:
    sockets.handler.snapshot, client = snapshot_at(0), look()
    ask(client, command)
    sockets.poll()
    reply = reported(client)
    assert reply["ok"] == (command in DOORS[Door.VIEW].commands)
    assert sockets.commands == ([command] if reply["ok"] else [])
    if not reply["ok"]:
        assert reply["message"] == f"{command}: {refusal(Door.VIEW, command)}"


def test_a_stop_of_a_viewer_overtakes_other_clients(sockets: SocketRig, look: Dial) -> None:
    person, viewer = sockets.dial(), look()
    sockets.poll()
    send(person, *["status"] * 6, "start")
    viewer.send(b'{"command": "stop", "on_behalf_of": "%s"}' % (b"x" * 64))
    sockets.poll(4)
    assert sockets.commands[0] == "stop"
    assert "start" not in sockets.commands
    assert reported(viewer)["ok"]
    *_, last = [reported(person) for _ in range(7)]
    assert "a stop overtook it" in str(last["message"])


def test_a_viewer_never_replaces_a_commanding_client(sockets: SocketRig, look: Dial) -> None:
    control = sockets.control
    people = [sockets.dial() for _ in range(10)]
    sockets.poll()
    viewers = inside(control, look, sockets.handler, 300)
    assert control.connections == 10 + DOORS[Door.VIEW].connections
    with contextlib.suppress(BlockingIOError):
        while len(people) < 256:
            people.append(sockets.dial())
            sockets.poll()
    sockets.poll()
    assert control.connections == 256
    for person in people:
        with pytest.raises(BlockingIOError):
            person.recv(10)
    assert "make room" in str(reported(viewers[0])["message"])
    ask(last := look(), "stop")  # commanding clients have taken all places
    sockets.poll()
    assert reported(last)["ok"]


def test_both_sockets_are_gone_at_the_end(control: ControlSocket) -> None:
    paths = control.path, view_socket_path(control.path)
    assert all(path.is_socket() for path in paths)
    assert all(path.stat().st_mode & 0o777 == 0o660 for path in paths)
    control.close()
    assert not any(path.exists() for path in paths)


def test_a_state_reports_who_armed_the_arm_and_for_how_long(on: ServedDaemon) -> None:
    with Client(view_socket_path(on.path)) as onlooker, Client(on.path) as owner:
        _, states = on.until(onlooker.subscribe)
        request = Arm(lease_s=3.0, on_behalf_of="anna")
        assert on.until(lambda: owner.ask(request)).ok
        first = until(on, states, lambda state: state.armed)
        later = until(on, states, lambda state: state.time_s >= first.time_s + 1.0)
        assert first.permit is not None
        assert later.permit is not None
        assert (first.permit.uid, first.permit.pid) == (os.getuid(), os.getpid())
        assert (first.permit.on_behalf_of, first.permit.detached) == ("anna", False)
        assert first.permit.left_s == pytest.approx(3.0, abs=0.05)
        passed_s = later.time_s - first.time_s
        assert later.permit.left_s == pytest.approx(first.permit.left_s - passed_s, abs=1e-6)
        stop = Stop(on_behalf_of="a phone at 192.0.2.7")
        assert on.until(lambda: onlooker_s_stop(on, stop)).ok
        last = until(on, states, lambda state: not state.armed)
        assert last.permit is None
        assert f"(pid {os.getpid()}) on behalf of a phone at 192.0.2.7" in last.cause


def onlooker_s_stop(served: ServedDaemon, request: Request) -> Reply:
    with Client(view_socket_path(served.path)) as client:
        return client.ask(request)


def until(served: ServedDaemon, states: Iterator[State], what: Callable[[State], bool]) -> State:
    """The first State of which `what` holds."""

    def search() -> State:
        return next(state for state in states if what(state))

    state = served.until(search)
    assert isinstance(state, State)
    return state


def test_a_viewer_gets_learned_friction_and_bus_load(on: ServedDaemon) -> None:
    on.run(1.0)
    estimator = on.rig.tick.estimator
    memory = estimator.memory()
    # Nothing was learned from an arm at rest: shares as a minute of work might leave them.
    shares = [[0.1, 0.03, -0.12, -0.17] for _ in memory["learning"]["shares"]]
    memory["learning"]["shares"] = shares
    estimator.restore(memory)
    with Client(view_socket_path(on.path)) as onlooker:
        status = on.until(onlooker.ask_status)
        snapshot, _ = on.until(onlooker.subscribe)
    assert status.learned is not None
    found = [status.learned.viscous, status.learned.coulomb, status.learned.load]
    for values, expected in zip(found, [-0.03, 0.12, 0.17], strict=True):
        assert values == pytest.approx([expected] * len(shares), abs=1e-3)
    assert "identify friction" in status.advice
    c = on.rig.robot.configuration
    assert snapshot.bus_load == bus_load(frames_of(c), c.bus.bitrate)
