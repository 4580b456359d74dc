"""Diagnoses: their texts, and how seldom the daemon is asked for its Status."""

from typing import Any

import pytest
from msgspec.structs import replace

from daemon.faults.conditions import Condition
from daemon.faults.symptoms import advice_of
from daemon.protocol.replies import Status
from programs.zenoh import diagnoses
from tests.fake_daemon import state_at
from tests.programs.zenoh.bridge import until

FAULT = f"{Condition.HEARTBEAT_LOST}: of LElbowRoll"


def advice(found: list[Any]) -> str | None:
    return dict(found[0].values).get("what to do")


@pytest.mark.parametrize(
    ("cause", "asked_of", "said"),
    [
        ("start", None, None),
        ("start", "start", "asked"),
        ("start", FAULT, None),  # what was asked for is of before
        (FAULT, None, advice_of(Condition.HEARTBEAT_LOST)),
        (FAULT, "start", advice_of(Condition.HEARTBEAT_LOST)),
        (FAULT, FAULT, "asked"),
    ],
)
def test_the_advice_belongs_to_the_cause(
    cause: str, asked_of: str | None, said: str | None, fake_daemon: Any
) -> None:
    status: Status | None = None
    if asked_of is not None:
        status = replace(fake_daemon.status(), cause=asked_of, advice="asked")
    joints = fake_daemon.status().joints
    assert advice(diagnoses.of(state_at(1, cause=cause), joints, "left", status)) == said


def asked(daemon: Any) -> int:
    return [command for command, _ in daemon.seen].count("status")


def test_a_status_is_asked_for_once_and_at_a_fault(
    fake_daemon: Any, routed: int, diagnostics: list[Any], start: Any
) -> None:
    """It takes more of the daemon's tick than the State does."""
    start(fake_daemon.path, routed)
    until(lambda: len(diagnostics) >= 4)
    assert asked(fake_daemon) == 1
    fake_daemon.states = lambda tick: state_at(tick, mode="faulted", cause=FAULT)
    until(lambda: asked(fake_daemon) == 2)
    known = len(diagnostics)
    until(lambda: len(diagnostics) >= known + 3)
    assert asked(fake_daemon) == 2
