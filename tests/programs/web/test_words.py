"""An arm in words on the page, also for daemons that send more or less than this one."""

import dataclasses
import json
import os
import pwd
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from msgspec.structs import replace

from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.faults.symptoms import advice_of
from daemon.modes.table import Mode
from daemon.protocol.state import Permit, State, Wrench
from drivers.canopen.cia402 import DriveState
from drivers.damiao.frames import Status
from drivers.damiao.language import STATUSES
from drivers.robstride.frames import RUN
from drivers.robstride.language import status_of
from programs.clients.styles import OPERATING
from programs.recordings.touch_point import TouchPoint
from programs.web.words import Load, Touch, force, load, owner, words
from tests.fake_daemon import state_at

CUP = SimpleNamespace(mass=0.4, com=[0.0, 0.1, 0.0])


def permit(**changes: Any) -> Permit:
    return replace(Permit(uid=os.getuid(), pid=7, detached=True, left_s=3.0), **changes)


def test_a_drive_under_power_is_known_by_the_name_of_each_make() -> None:
    names = {
        DriveState.OPERATION_ENABLED.name.replace("_", " ").lower(),
        STATUSES[Status.ENABLED].words,
        status_of(RUN << 6).words,
    }
    assert names == set(OPERATING)
    page = (Path(__file__).parents[3] / "page" / "src" / "joints.js").read_text()
    known = re.search(r"OPERATING = new Set\((\[.*\])\)", page)
    assert known is not None
    assert set(json.loads(known[1])) == names


def test_the_owner_has_a_name() -> None:
    name = pwd.getpwuid(os.getuid()).pw_name
    assert owner(permit()) == name
    assert owner(permit(on_behalf_of="anna")) == f"{name} on behalf of anna"
    assert owner(permit(uid=4_000_000)) == "uid 4000000"


def test_the_time_left_of_a_permit_changes_no_words() -> None:
    """The lease's countdown is in the frames: words are not sent anew for it."""
    state = replace(state_at(5), armed=True, permit=permit())
    later = replace(state_at(6), cause=state.cause, permit=permit(left_s=2.0))
    assert words(0, state) == words(0, replace(later, mode=state.mode))


@pytest.mark.parametrize("condition", list(Condition))
def test_the_advice_for_a_fault_needs_no_answer_of_the_daemon(condition: Condition) -> None:
    for finding in (Finding(condition), Finding(condition, "LElbowRoll (left)", "3: 4 Nm")):
        state = replace(state_at(5), cause=str(finding))
        assert words(0, state).advice == advice_of(condition)
    for cause in ("", "started", f"not {condition}", f"{condition}er"):
        assert words(0, replace(state_at(5), cause=cause)).advice == ""


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
def test_a_load_is_reported_where_a_state_has_one(
    fields: dict[str, Any], announced: bool | None
) -> None:
    found = load(cast(State, SimpleNamespace(**fields)))
    expected = announced is not None and Load(announced, 0.4, [0.0, 0.1, 0.0], None, str(CUP))
    assert found == (expected or None)


PUSH = Wrench(
    force=[0.0, 0.0, -18.0], covariance=[9.0, 0.0, 0.0, 1.0, 0.0, 4.0], unseen=[], strength=4.0,
    misfit=0.8,
)  # fmt: skip


def test_a_point_of_contact_goes_to_the_page_where_it_is_known() -> None:
    found = TouchPoint(
        joints=("joint",), sure=0.9, decided=True, link="arm", point=np.array([0.071, -0.004, 0.0]),
        doubt_m=0.043, force=np.zeros(3), misfit=0.5,
    )  # fmt: skip
    shown = words(0, state_at(5), found).touch
    assert shown == Touch(link="arm", point=[0.08, 0.0, 0.0], doubt=0.04, text="arm ± 4 cm")
    assert words(0, state_at(5), dataclasses.replace(found, doubt_m=0.2)).touch is None
    assert words(0, state_at(5)).touch is None


@pytest.mark.parametrize(
    ("mode", "changes", "shown"),
    [
        ("holding", {}, True),
        ("off", {}, False),
        ("holding", {"misfit": 2.1}, False),
        ("holding", {"force": [0.0, 0.0, 0.0]}, False),
    ],
)
def test_a_force_is_drawn_where_one_fits_and_the_mode_senses(
    mode: str, changes: dict[str, Any], shown: bool
) -> None:
    found = force(replace(state_at(5), mode=Mode(mode), wrench=replace(PUSH, **changes)))
    assert (found is not None) == shown
    if found is not None:
        assert (found.way, found.size, found.text) == ([0.0, 0.0, -1.0], 18.0, "18 N ± 4")
        assert found.cone == pytest.approx(0.3)  # atan(1.96 * 3 / 18), to a tenth
    assert force(cast(State, SimpleNamespace(mode=Mode.HOLDING))) is None
