"""Stages of a release: what its end leads to, and what another change of the mode does."""

import pytest

from daemon.modes.release_stage import LEFT, Ending, ReleaseStage, after_change, after_release
from daemon.modes.table import Event

S, E = ReleaseStage, Event


@pytest.mark.parametrize(
    ("event", "end", "stage"),
    [
        (E.HALT, Ending.CONTACT_ENDED, S.CONTACT_ENDED),
        (E.HALT, Ending.UNSURE, S.UNFINISHED),
        (E.HALT, Ending.ELSEWHERE, S.RELEASED),
        (E.HALT, None, S.RELEASED),  # another collision, configured to hold
        (E.BOUND, Ending.BOUND, S.RELEASED),
        (E.BOUND, Ending.TIME, S.RELEASED),
        (E.STOP, None, S.RELEASED),
        (E.DOUBT, None, S.UNFINISHED),
        (E.DOUBT, Ending.CONTACT_ENDED, S.UNFINISHED),
        (E.FAULT, None, S.RELEASED),
    ],
)
def test_stage_after_a_release(event: Event, end: Ending | None, stage: ReleaseStage) -> None:
    assert after_release(event, end) is stage


def test_only_an_arm_that_let_go_changes_its_stage_with_another_mode() -> None:
    changed = {stage: after_change(stage) for stage in S}
    assert changed == {**{stage: stage for stage in S}, S.CONTACT_ENDED: S.RELEASED}


def test_a_contact_may_be_left_after_every_release() -> None:
    assert frozenset(S) - {S.NONE} == LEFT
