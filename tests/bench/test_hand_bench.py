"""Arm that waits while a hand rests on it, and is led by a hand; targets of `bench.hand`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.hand import Job, Result, targets
from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.study import leading
from bench.study.circle import circles
from bench.study.leading import Led, Rested, arm_at_work, lead, let_go, pull, rest, robot_of
from daemon.modes.table import Event, Mode

SEED, WORK_S = 3, 10.0


@pytest.fixture(scope="module")
def arm() -> ArmInTheLoop:
    return arm_at_work(robot_of(assists=True), SEED, WORK_S)


def trial(arm: ArmInTheLoop, share: float) -> Rested:
    return rest(arm, share, 1500.0, np.random.default_rng(SEED))


def test_a_trajectory_does_not_go_on_in_a_hand_that_rests(
    arm: ArmInTheLoop, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(leading, "RESTS_S", 5.0)
    notices: list[str] = []
    step = arm.step

    def noted() -> None:
        step()
        notices.extend(notice.text for notice in arm.last.notices)

    monkeypatch.setattr(arm, "step", noted)
    found = trial(arm, 0.15)  # below SHARE on every joint: by what the tool's force makes of all
    assert not found.missed
    assert found.let_go_s < leading.LEAVES_S  # and goes on once the hand left
    assert len([text for text in notices if text.startswith("something rests on ")]) == 1


def test_without_a_hand_it_goes_on_after_the_quiet_time(arm: ArmInTheLoop) -> None:
    assert 2.0 <= trial(arm, 0.0).let_go_s < 2.2


def test_one_that_does_not_probe_goes_on_in_the_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leading, "RESTS_S", 3.0)
    arm = arm_at_work(robot_of(probes=False), SEED, WORK_S)
    assert trial(arm, 0.55).missed


def paused(arm: ArmInTheLoop) -> ArmInTheLoop:
    arm.request(Event.PAUSE)
    while arm.mode is not Mode.HOLDING:
        arm.step()
    return arm


def led(arm: ArmInTheLoop) -> Led:
    found = lead(paused(arm), 3, 1500.0)
    assert found is not None
    return found


def test_a_joint_is_led_and_with_less_force_where_the_arm_assists(arm: ArmInTheLoop) -> None:
    found, without = led(arm), led(arm_at_work(robot_of(), SEED, WORK_S))
    assert found.leads_off < found.leads < 0.75 * without.leads
    assert 6.0 < without.leads < 15.0
    assert found.work_off < found.work < without.work
    assert 0.0 <= found.rebounds_rad < found.coasts_rad < 0.02


@pytest.mark.parametrize(
    ("moved", "way", "coasts", "rebounds"),
    [(0.02, 1.0, 0.02, 0.0), (-0.02, -1.0, 0.02, 0.0), (-0.02, 1.0, 0.01, 0.02)],
)
def test_a_joint_coasts_onwards_and_springs_back(
    moved: float, way: float, coasts: float, rebounds: float
) -> None:
    assert let_go(np.array([-0.01, moved]), 1, way) == (coasts, rebounds)


def test_a_steady_torque_carries_an_arm_that_assists_further() -> None:
    without, with_it = (
        pull(paused(arm_at_work(robot_of(assists=assists), SEED, WORK_S)), 2)
        for assists in (False, True)
    )
    assert 0.1 < without < 0.8 * with_it


def test_a_circle_is_drawn_by_the_hand_with_and_without_the_assist(tmp_path: Path) -> None:
    drawn = circles(SEED, 2.0, tmp_path / "circle.png")
    assert {name: 3.0 < one["median_N"] < 20.0 for name, one in drawn.items()} == {
        "assist": True, "no assist": True,
    }  # fmt: skip
    assert all(0.04 < one["least_radius_m"] < 0.06 for one in drawn.values())
    assert drawn["assist"] != drawn["no assist"]
    assert (tmp_path / "circle.png").read_bytes().startswith(b"\x89PNG")


LED = Led("a", 3.0, 2.0, 1.0, 5.0, 1.5, 2.0, 1.0, 0.0, 0.01, 0.01)
RESTED = Rested(0.5, "a", 300.0, 1.0, np.inf, 2.1)
ALONE = replace(RESTED, share=0.0)
GOOD = Result(Job(1, "leads"), [LED], [RESTED, ALONE], {})


@pytest.mark.parametrize(
    ("result", "unmet"),
    [
        (GOOD, set()),
        (replace(GOOD, led=[LED, replace(LED, leads=13.0)]),
         {"leads, worst joint", "largest over smallest force"}),
        (replace(GOOD, led=[replace(LED, sets_out=5.0)]),
         {"sets out, worst joint", "sets out beyond that, unnamed"}),
        (replace(GOOD, led=[replace(LED, sets_out=5.0, stated=4.1),
                            replace(LED, sets_out=5.0, friction=2.1)]),
         {"sets out, worst joint"}),
        (replace(GOOD, led=[replace(LED, work=2.0)]),
         {"work over that of drives off, median"}),
        (replace(GOOD, led=[replace(LED, coasts_rad=0.03, tremble=0.5)]),
         {"coasts, furthest", "trembles"}),
        (replace(GOOD, led=[replace(LED, rebounds_rad=0.03)]), {"springs back"}),
        (replace(GOOD, rested=[replace(RESTED, went_on_s=1.0, let_go_s=np.nan), ALONE]),
         {"goes on in a hand that rests"}),
        (replace(GOOD, rested=[replace(RESTED, let_go_s=np.inf), replace(ALONE, let_go_s=3.0)]),
         {"waits on after it left", "goes on as usual without one"}),
    ],
)  # fmt: skip
def test_the_worst_decides(result: Result, unmet: set[str]) -> None:
    assert {target.name for target in targets([result]) if not target.met} == unmet
