"""Arming at the instant in which somebody else's lease ends."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

from daemon.protocol.messages import Check, Request
from daemon.protocol.socket_path import Peer
from daemon.service.permission import Permission
from daemon.tick.controller import Controller


@dataclass
class Arm:
    """As much of a controller as can be armed; `told` is what happened to it."""

    machine: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(armed=False))
    told: list[str] = field(default_factory=list)

    def arm(self, who: str) -> list[str]:
        self.machine.armed = True
        self.told.append("armed")
        return []

    def disarm(self, why: str, time_s: float) -> None:
        self.machine.armed = False
        self.told.append(f"disarmed: {why}")


def test_a_lease_that_has_run_out_is_not_taken_over_without_checks() -> None:
    arm, asked = Arm(), []
    checks = [Check(name="loop", passed=True, text="on time")]

    def look() -> list[Check]:
        asked.append(len(asked))
        return checks

    permission = Permission(cast(Controller, arm), look)
    first, second = Peer(1000, 11, 1), Peer(1001, 12, 2)
    request: Any = Request("arm", lease_s=0.5)
    assert not permission.arm(request, first, 0.0).reasons
    assert permission.arm(request, second, 0.4).reasons  # it is another's
    answer = permission.arm(request, second, 0.5)  # no tick came between
    assert answer.checks == checks
    assert len(asked) == 2
    assert [words.split(":")[0] for words in arm.told] == ["armed", "disarmed", "armed"]
