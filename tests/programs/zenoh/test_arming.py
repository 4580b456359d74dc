"""Arming by calls: in lockstep with the daemon, whose leases end with silence."""

from dataclasses import dataclass
from typing import Any

import pytest

from bench.rigs.served_daemon import ServedDaemon
from common.errors import UnreachableError
from daemon.protocol.replies import Reply
from daemon.protocol.requests import Disarm, Request, bare
from daemon.protocol.socket_path import Peer
from programs.zenoh.arming import Arming
from programs.zenoh.holding import FIRST_CALL_S, HOLD_S, ONCE, RELEASE_FIRST
from programs.zenoh.messages import read_outcome
from programs.zenoh.names import Distro, Node
from programs.zenoh.serve import Settings, offers

NODE = Node(0, "/left_arm", "contactd", Distro.JAZZY)
A, B = b"a" * 16, b"b" * 16
TRUE, FALSE = b"\0\1\0\0\1", b"\0\1\0\0\0\0\0\0"


@dataclass
class Call:
    """A call without a network."""

    request: bytes
    gid: bytes
    sent_s: float

    @property
    def caller(self) -> str:
        return f"ROS 2 client {self.gid.hex()}"

    def answer(self, payload: bytes) -> None:
        raise NotImplementedError

    def refuse(self, why: str) -> None:
        raise NotImplementedError


class Line:
    """Connection to a daemon in lockstep: answers take no time."""

    def __init__(self, served: ServedDaemon, number: int) -> None:
        self._served, self._peer = served, Peer(1000, 7, number)
        self.asked: list[str] = []
        self.reachable = True

    def ask(self, request: Request) -> Reply:
        if not self.reachable:
            raise UnreachableError("the daemon does not answer")
        self.asked.append(request.command)
        return self._served.service.commands.handle(request, self._peer)

    def close(self) -> None:
        self._served.service.control.on_close(self._peer)


class Ros:
    """Callers of `arm`, the service, and the daemon."""

    def __init__(self, served: ServedDaemon) -> None:
        self.served = served
        self.lines: list[Line] = []
        self.arming = Arming(self._connect, self._disarm, lambda: served.rig.time_s)

    def _connect(self) -> Line:
        self.lines.append(Line(self.served, len(self.lines) + 1))
        return self.lines[-1]

    def _disarm(self, who: str) -> tuple[bool, str]:
        reply = self.served.service.commands.handle(Disarm(on_behalf_of=who), Peer(1, 8, 100))
        return reply.ok, reply.message

    def say(self, request: bytes = TRUE, gid: bytes = A, late_s: float = 0.0) -> tuple[bool, str]:
        (answer,) = self.arming.answer([Call(request, gid, self.served.rig.time_s - late_s)])
        return read_outcome(answer)

    def arm(self, gid: bytes = A) -> tuple[bool, str]:
        """The call that does not arm yet, and the one that does."""
        assert self.say(gid=gid) == (False, ONCE)
        self.served.run(FIRST_CALL_S + 0.01)
        return self.say(gid=gid)

    @property
    def armed(self) -> bool:
        return self.served.rig.tick.controller.machine.armed

    def armed_for_s(self) -> float:
        """Time until it is not armed any more, while all are silent."""
        begun_s = self.served.rig.time_s
        while self.armed:
            self.served.tick()
        return self.served.rig.time_s - begun_s


@pytest.fixture
def ros(served: ServedDaemon) -> Ros:
    served.rig.enable()
    served.run(0.5)
    return Ros(served)


def test_a_caller_that_calls_keeps_it_armed_and_its_silence_ends_it(ros: Ros) -> None:
    assert ros.arm() == (True, "arm: holding, armed for 0.8 s")
    for _ in range(20):
        ros.served.run(0.2)
        assert ros.say() == (True, "renew: holding, armed for 0.8 s")
        assert ros.armed
    permit = ros.served.service.commands.permission.permit(ros.served.rig.time_s)
    assert permit is not None
    assert permit.on_behalf_of == f"ROS 2 client {A.hex()}"
    assert ros.armed_for_s() == pytest.approx(HOLD_S, abs=0.015)  # whole ticks


def test_false_disarms_and_true_arms_again(ros: Ros) -> None:
    ros.arm()
    assert ros.say(FALSE)[0]
    assert not ros.armed
    assert ros.arm()[0]
    assert ros.armed


def test_only_the_holder_renews_and_every_caller_may_disarm(ros: Ros) -> None:
    ros.arm()
    assert ros.say(gid=B) == (False, "another client keeps it armed")
    assert ros.say(FALSE, gid=B)[0]
    assert not ros.armed
    assert ros.say() == (False, RELEASE_FIRST)


@pytest.mark.parametrize("command", ["disarm", "stop"])
def test_calls_that_go_on_do_not_undo_what_a_person_does(ros: Ros, command: Any) -> None:
    ros.arm()
    ros.served.service.commands.handle(bare(command), Peer(2, 9, 101))
    ros.served.run(0.5)
    assert ros.say() == (
        False,
        f"{RELEASE_FIRST} (renew: refused; not armed any more: `arm` it anew)",
    )
    for _ in range(20):
        ros.served.run(0.2)
        assert ros.say() == (False, RELEASE_FIRST)
        assert not ros.armed
    ros.say(FALSE)
    assert ros.arm()[0]


def test_calls_that_were_held_up_prolong_nothing(ros: Ros) -> None:
    """A router that hangs and goes on delivers what it kept, of a caller that may be gone."""
    ros.arm()
    ros.served.run(0.6)
    for late_s in (0.6, 0.4, 0.2):
        ros.say(late_s=late_s)
    assert ros.armed_for_s() == pytest.approx(HOLD_S - 0.2, abs=0.025)
    for _ in range(10):
        assert not ros.say(late_s=0.1)[0]
    assert not ros.armed


def test_a_crowd_of_calls_is_a_few_commands_and_each_is_answered(ros: Ros) -> None:
    ros.say()
    ros.served.run(FIRST_CALL_S + 0.01)
    now_s = ros.served.rig.time_s
    calls = [Call(TRUE, A, now_s) for _ in range(30)]
    calls += [Call(TRUE, bytes([i] * 16), now_s) for i in range(1, 30)]
    answers = ros.arming.answer(calls)
    assert len(answers) == 59
    assert [read_outcome(answer)[0] for answer in answers] == [True] * 30 + [False] * 29
    assert [line.asked for line in ros.lines] == [["arm"]]


def test_a_daemon_that_refuses_or_is_gone(ros: Ros) -> None:
    ros.arm()
    ros.lines[-1].reachable = False
    assert ros.say() == (False, "not reached: the daemon does not answer")
    assert ros.armed_for_s() == pytest.approx(0.0)  # it hung up
    assert ros.say() == (False, RELEASE_FIRST)
    ros.say(FALSE)
    ros.served.service.commands.ending = True
    assert ros.arm() == (False, "arm: refused; the daemon is ending")


def test_a_call_of_an_unknown_caller_does_not_arm(ros: Ros) -> None:
    assert ros.say(gid=bytes(16))[1].startswith("a call without an attachment")
    assert not ros.armed
    ros.arm()
    assert ros.say(FALSE, gid=bytes(16))[0]  # any caller may disarm
    assert not ros.armed


def test_the_end_of_the_service_ends_it(ros: Ros) -> None:
    ros.arm()
    ros.arming.offer().close()
    assert not ros.armed


@pytest.mark.parametrize(("control", "allowed"), [(False, True), (True, False), (False, False)])
def test_arm_is_offered_only_with_the_control_socket_and_its_option(
    served: ServedDaemon, control: bool, allowed: bool
) -> None:
    full = served.path if control else None
    settings = Settings(served.path, full, NODE, (), None, allowed)
    assert "arm" not in offers(settings)
    both = Settings(served.path, served.path, NODE, (), None, arming=True)
    assert set(offers(both)) == {"stop", "disarm", "reset", "arm"}
