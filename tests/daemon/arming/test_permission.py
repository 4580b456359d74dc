"""Arming at the instant in which another owner's lease ends."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

from daemon.arming.checks import ArmingChecks, ArmingResult
from daemon.arming.permission import Permission
from daemon.protocol import requests
from daemon.protocol.replies import Check
from daemon.protocol.socket_path import Peer
from daemon.tick.tick import Tick

CHECKS = (Check(name="loop", passed=True, text="on time"),)


@dataclass
class Arm:
    """As much of a tick and its controller as can be armed; `reported` is what happened to it."""

    machine: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(armed=False))
    reported: list[str] = field(default_factory=list)
    checked_s: list[float] = field(default_factory=list)
    against: tuple[str, ...] = ()

    @property
    def controller(self) -> "Arm":
        return self

    def run(self, time_s: float) -> ArmingResult:
        self.checked_s.append(time_s)
        return ArmingResult(CHECKS, self.against)

    def arm(self, who: str) -> list[str]:
        self.machine.armed = True
        self.reported.append("armed")
        return []

    def disarm(self, why: str, time_s: float) -> None:
        self.machine.armed = False
        self.reported.append(f"disarmed: {why}")


def test_a_lease_that_has_run_out_is_not_taken_over_without_checks() -> None:
    arm = Arm()
    permission = Permission(cast(Tick, arm), cast(ArmingChecks, arm))
    first, second = Peer(1000, 11, 1), Peer(1001, 12, 2)
    request: Any = requests.Arm(lease_s=0.5)
    assert not permission.arm(request, first, 0.0).reasons
    assert permission.arm(request, second, 0.4).reasons  # it is another's
    answer = permission.arm(request, second, 0.5)  # no tick came between
    assert answer.checks == CHECKS
    assert arm.checked_s == [0.0, 0.5]
    assert [words.split(":")[0] for words in arm.reported] == ["armed", "disarmed", "armed"]


def test_a_failed_check_never_reaches_the_controller() -> None:
    arm = Arm(against=("late", "touched"))
    permission = Permission(cast(Tick, arm), cast(ArmingChecks, arm))
    answer = permission.arm(requests.Arm(), Peer(1000, 11, 1), 0.0)
    assert (list(answer.reasons), answer.checks) == (["late", "touched"], CHECKS)
    assert arm.reported == []
    assert permission.permit(0.0) is None
