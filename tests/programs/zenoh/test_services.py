"""Services: bounded, within their socket's permissions; many calls are a few commands."""

import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from contactd_client.paths import view_socket_path
from programs.zenoh.messages import outcome
from programs.zenoh.services import BUSY, MOST_WAITING, Outcome, Service, actions, trigger

TRIGGER = b"\0\1\0\0\0"


@dataclass
class Call:
    """A call without a network."""

    request: bytes = TRIGGER
    caller: str = "ROS 2 client 00"
    gid: bytes = bytes(16)
    sent_s: float = 0.0
    answers: list[bytes | str] = field(default_factory=list)
    answered: threading.Event = field(default_factory=threading.Event)

    def answer(self, payload: bytes) -> None:
        self.answers.append(payload)
        self.answered.set()

    def refuse(self, why: str) -> None:
        self.answers.append(why)
        self.answered.set()


class Gate:
    """An action that waits to be let through, and counts."""

    def __init__(self) -> None:
        self.began, self.open, self.done = threading.Event(), threading.Event(), 0

    def __call__(self, who: str) -> Outcome:
        self.began.set()
        self.open.wait()
        self.done += 1
        return True, "done"


def test_a_flood_is_a_few_commands_and_each_call_has_one_answer() -> None:
    gate = Gate()
    service = Service("stop", trigger(gate))
    first = Call()
    service.put(first)
    gate.began.wait()
    calls = [Call() for _ in range(1000)]
    for call in calls:
        service.put(call)
    gate.open.set()
    for call in (first, *calls):
        call.answered.wait()
    service.close()
    answers = [call.answers for call in calls]
    assert all(len(one) == 1 for one in answers)
    assert answers.count([outcome(True, "done")]) == MOST_WAITING
    assert answers.count([BUSY]) == 1000 - MOST_WAITING
    assert gate.done == 2


def test_calls_that_wait_at_the_end_are_answered() -> None:
    gate = Gate()
    service = Service("stop", trigger(gate))
    service.put(Call())
    gate.began.wait()
    waiting = Call()
    service.put(waiting)
    closing = threading.Thread(target=service.close)
    closing.start()
    while closing.is_alive() and not service.ended:
        time.sleep(0.001)
    gate.open.set()
    closing.join()
    late = Call()
    service.put(late)
    assert waiting.answers == ["the bridge is ending"]
    assert late.answers == [BUSY]


def test_an_action_that_fails_is_answered_and_the_next_call_is_carried_out() -> None:
    failures = [OSError(24, "Too many open files")]

    def act(_who: str) -> Outcome:
        if failures:
            raise failures.pop()
        return True, "done"

    service = Service("stop", trigger(act))
    first, second = Call(), Call()
    for call in (first, second):
        service.put(call)
        assert call.answered.wait(10.0)
    service.close()
    assert first.answers == ["system error: [Errno 24] Too many open files"]
    assert second.answers == [outcome(True, "done")]


@pytest.mark.parametrize("request_", [b"", b"\0\1\0", b"\0" * 9, b"\xff" * 5])
def test_an_invalid_request_does_nothing(request_: bytes) -> None:
    gate = Gate()
    gate.open.set()
    service = Service("stop", trigger(gate))
    call = Call(request_)
    service.put(call)
    service.close()
    assert "no Trigger request" in str(call.answers)
    assert gate.done == 0


def commands(daemon: Any) -> list[str]:
    return [command for command, _ in daemon.seen if command != "status"]


def test_the_view_socket_offers_only_stop_and_disarm(fake_daemon: Any) -> None:
    offered = actions(view_socket_path(fake_daemon.path), None)
    assert set(offered) == {"stop", "disarm"}
    assert offered["stop"]("ROS 2 client 00") == (True, "stands")
    assert offered["disarm"]("ROS 2 client 00") == (True, "stands")
    assert commands(fake_daemon) == ["stop", "disarm"]


def test_a_stop_without_confirmed_standstill_is_no_success(fake_daemon: Any) -> None:
    fake_daemon.unproved = ["LElbowRoll"]
    offered = actions(view_socket_path(fake_daemon.path), None)
    assert offered["stop"]("x") == (False, "not seen to stand: LElbowRoll")


def test_reset_needs_the_control_socket(fake_daemon: Any) -> None:
    fake_daemon.refusals["reset"] = ["no fault is latched"]
    view = view_socket_path(fake_daemon.path)
    offered = actions(view, fake_daemon.path)
    assert offered["reset"]("x") == (False, "reset is refused; no fault is latched")
    del fake_daemon.refusals["reset"]
    assert offered["reset"]("x") == (True, "reset done")
    done, said = actions(view, view)["reset"]("x")  # the wrong socket was given
    assert not done
    assert "the view socket takes only" in said


def test_a_missing_daemon_is_reported(tmp_path: Path) -> None:
    offered = actions(tmp_path / "view", tmp_path / "control")
    for name in ("stop", "disarm", "reset"):
        done, said = offered[name]("x")
        assert not done
        assert said.startswith("not reached: no contactd serves")
