"""What the page says of an arm in words, also of daemons that tell more or less than this one."""

import os
import pwd
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest
from msgspec.structs import replace

from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.faults.symptoms import advice_of
from daemon.protocol.state import Permit, State
from programs.web.words import Load, load, owner, words

CUP = SimpleNamespace(mass=0.4, com=[0.0, 0.1, 0.0])


def permit(**changes: Any) -> Permit:
    return replace(Permit(uid=os.getuid(), pid=7, detached=True, left_s=3.0), **changes)


def test_the_owner_has_a_name() -> None:
    name = pwd.getpwuid(os.getuid()).pw_name
    assert owner(permit()) == name
    assert owner(permit(on_behalf_of="anna")) == f"{name} on behalf of anna"
    assert owner(permit(uid=4_000_000)) == "uid 4000000"


def test_words_change_only_with_what_they_say(make_state: Callable[..., State]) -> None:
    """The lease's countdown is in the frames: words are not sent anew for it."""
    state = replace(make_state(5), armed=True, permit=permit())
    later = replace(make_state(6), cause=state.cause, permit=permit(left_s=2.0))
    assert words(0, state) == words(0, replace(later, mode=state.mode))


@pytest.mark.parametrize("condition", list(Condition))
def test_what_to_do_about_a_fault_needs_no_answer_of_its_daemon(
    make_state: Callable[..., State], condition: Condition
) -> None:
    for finding in (Finding(condition), Finding(condition, "LElbowRoll (left)", "3: 4 Nm")):
        state = replace(make_state(5), cause=str(finding))
        assert words(0, state).advice == advice_of(condition)
    for cause in ("", "started", f"not {condition}", f"{condition}er"):
        assert words(0, replace(make_state(5), cause=cause)).advice == ""


@pytest.mark.parametrize(
    ("fields", "announced"),
    [
        ({}, None),
        ({"payload": None, "recognised": None}, None),
        ({"payload": CUP}, True),
        ({"payload": CUP, "recognised": CUP}, False),
        ({"payload": None, "recognised": CUP}, False),
    ],
)
def test_a_load_is_told_where_a_state_has_one(
    fields: dict[str, Any], announced: bool | None
) -> None:
    found = load(cast(State, SimpleNamespace(**fields)))
    expected = announced is not None and Load(announced, 0.4, [0.0, 0.1, 0.0], str(CUP))
    assert found == (expected or None)
