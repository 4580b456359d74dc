"""Motion of the arm in each mode, from made-up observations of a single ideal joint."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.modes.table import Event, Mode
from daemon.motion.admittance import AllowanceSettings
from daemon.motion.sampled_path import PathBuilder, SampledPath
from drivers.api import PowerTarget
from tests.ideal_arm import (
    LIMITS,
    OFF,
    ON,
    TUNING,
    IdealArm,
    T,
    holding_arm,
    ideal_arm,
    tracking_arm,
)

COMMANDS = ("enable", "start", "pause", "stop", "disarm", "disable", "reset")


def never_jumped(arm: IdealArm) -> bool:
    """Whatever happened, except to the zero of a quick stop."""
    velocities = np.array([decision.velocity for decision in arm.decisions])
    step = np.abs(np.diff(velocities, axis=0))
    return arm.mode is Mode.FAULTED or bool((step <= LIMITS.acceleration * T + 1e-12).all())


@pytest.fixture
def holding() -> IdealArm:
    return holding_arm()


@pytest.fixture
def tracking() -> Iterator[IdealArm]:
    """Armed."""
    arm = tracking_arm()
    yield arm
    assert never_jumped(arm)


@pytest.fixture
def unarmed() -> Iterator[IdealArm]:
    arm = tracking_arm()
    assert arm.request(Event.DISARM) == []
    yield arm
    assert never_jumped(arm)


def test_armed_a_contact_leads_to_admittance(tracking: IdealArm) -> None:
    tracking.touch()
    assert tracking.mode is Mode.ADMITTANCE
    assert tracking.cause == "a feels it"
    tracking.run(1.0, **tracking.push(0.4))
    assert tracking.decisions[-1].velocity[0] == pytest.approx(0.2, rel=1e-3)  # K_a r_bar


def test_after_two_quiet_seconds_it_goes_on_from_where_it_was_left(tracking: IdealArm) -> None:
    tracking.touch()
    tracking.run(0.5, **tracking.push(0.6))
    last = tracking.time_s - T
    while tracking.mode is Mode.ADMITTANCE:
        tracking.step()
    assert tracking.mode is Mode.TRACKING
    assert 2.0 - 1e-9 <= tracking.time_s - T - last <= 2.01 + 1e-9
    np.testing.assert_allclose(tracking.decisions[-1].reference, tracking.q, atol=1e-3)
    assert tracking.armed
    tracking.run(1.0)
    assert abs(tracking.decisions[-1].velocity[0]) > 0.05


def test_the_quiet_time_begins_with_the_contact_however_faint(tracking: IdealArm) -> None:
    tracking.touch(0.0)
    tracking.run(1.9)
    assert tracking.mode is Mode.ADMITTANCE
    tracking.run(0.2)
    assert tracking.mode is Mode.TRACKING


def test_touched_while_holding_it_holds_where_it_was_left(holding: IdealArm) -> None:
    holding.controller.arm("me")
    holding.touch()
    assert holding.mode is Mode.ADMITTANCE
    holding.run(0.3, **holding.push(0.6))
    holding.run(2.1)
    assert holding.mode is Mode.HOLDING
    left = holding.q.copy()
    holding.run(0.5)
    np.testing.assert_allclose(holding.q, left, atol=1e-3)


@pytest.mark.parametrize(
    ("torque", "words"), [(2.0, "further than 0.4 rad"), (0.01, "more than 5 s")]
)
def test_a_bound_ends_guiding_and_disarms(tracking: IdealArm, torque: float, words: str) -> None:
    tracking.touch(torque)
    for _ in range(600):
        tracking.step(**tracking.push(torque))
        if tracking.mode is not Mode.ADMITTANCE:
            break
    assert tracking.mode is Mode.STOPPING
    assert words in tracking.cause
    tracking.run(0.5)
    assert tracking.mode is Mode.HOLDING
    assert not tracking.armed
    assert not tracking.controller.machine.moving


def led_to_the_limit(**changes: Any) -> IdealArm:
    """Joint a, which swings by 0.3, was led to where it does not fit; 2 s ago."""
    bounds = AllowanceSettings(max_duration_s=20.0, max_excursion=3.0)
    bench = tracking_arm(bounds=bounds, **changes)
    bench.run(3.0, **bench.push(1.0))
    assert bench.q[0] > 0.9
    bench.run_until(Mode.RETURNING)
    return bench


def test_a_path_that_no_longer_fits_goes_on_from_the_nearest_place_where_it_does() -> None:
    bench = led_to_the_limit()
    assert "the path of a would leave its limits [-1, 1]" in bench.cause
    left, swing = bench.q[0], bench.controller.motion.follower.place.path
    bench.run_until(Mode.TRACKING)
    # No further than it must: its highest point is the limit.
    place = bench.controller.motion.follower.place
    assert bench.q[0] == pytest.approx(0.7 + swing.offset(place.s)[0], abs=0.011)
    assert bench.q[0] < left
    assert bench.armed
    where = []
    for _ in range(1000):
        bench.step()
        where.append(bench.q[0])
    assert bench.mode is Mode.TRACKING
    assert max(where) == pytest.approx(1.0, abs=5e-3)
    assert max(where) <= 1.0
    assert min(where) == pytest.approx(0.4, abs=5e-3)


def test_touched_on_the_way_back_it_yields_and_tries_again() -> None:
    bench = led_to_the_limit()
    bench.touch()
    assert bench.mode is Mode.ADMITTANCE
    bench.run_until(Mode.RETURNING)
    bench.run_until(Mode.TRACKING)


def test_a_path_that_fits_nowhere_ends_in_holding_with_the_reason() -> None:
    bench = led_to_the_limit()
    bench.touch()
    narrow = replace(LIMITS, lower=np.array([0.6, -1.0]), upper=np.array([0.95, 1.0]))
    bench.controller.motion.limits = narrow
    bench.run_until(Mode.HOLDING)
    assert "the path of a would leave its limits [0.6, 0.95]" in bench.cause
    assert not bench.controller.machine.moving


def test_disarmed_while_guided_nothing_goes_on_by_itself_later(tracking: IdealArm) -> None:
    tracking.touch()
    tracking.request(Event.DISARM)
    assert tracking.mode is Mode.STOPPING
    tracking.run(0.5)
    tracking.touch()
    tracking.run(2.5)
    assert tracking.mode is Mode.HOLDING


def test_drives_that_do_not_follow_time_out() -> None:
    bench = ideal_arm()
    bench.step()
    bench.request(Event.ENABLE)
    bench.run(2.9, drives=(ON, OFF))
    assert bench.mode is Mode.ENABLING
    bench.run(0.2, drives=(ON, OFF))
    assert bench.mode is Mode.OFF
    assert bench.cause == ("the drives were not enabled within 3 s: b is in off, as it reports")


def test_an_arm_that_does_not_stop_is_a_fault(tracking: IdealArm) -> None:
    tracking.request(Event.STOP)
    tracking.run(3.1, motor_velocity=np.array([0.0, 0.1]))
    assert tracking.mode is Mode.FAULTED


def test_a_fault_stops_all_drives_until_reset(tracking: IdealArm) -> None:
    fault = (Finding(Condition.DRIVE_FAULT, "b"),)
    decision = tracking.step(findings=fault)
    assert tracking.mode is Mode.FAULTED
    assert decision.power == (PowerTarget.QUICK_STOP,) * 2
    assert not decision.velocity.any()
    tracking.request(Event.RESET)
    assert tracking.step(findings=fault).reset  # the drive may still be in fault
    assert tracking.mode is Mode.OFF
    tracking.run(0.6, findings=fault)
    assert tracking.mode is Mode.FAULTED
    tracking.step()
    assert tracking.mode is Mode.FAULTED


def test_power_in_each_mode(holding: IdealArm) -> None:
    assert holding.step().power == (PowerTarget.ON,) * 2
    holding.request(Event.DISABLE)
    assert holding.step().power == (PowerTarget.QUICK_STOP, PowerTarget.OFF)  # hold, brake


def recorded(*rows: list[float], from_here: bool = False) -> SampledPath:
    builder = PathBuilder("move.csv", TUNING.joints, ["a"], LIMITS, 1.0, from_here=from_here)
    builder.append(rows)
    return builder.finish()


MOVE = recorded([0.0, 0.1, 0.0], [1.0, 0.4, 0.3], [2.0, 0.5, 0.0])


def start(bench: IdealArm, path: SampledPath | None = None) -> list[str]:
    return bench.controller.request(Event.START, "me", bench.time_s, path)


def test_a_recorded_trajectory_runs_to_its_end_and_holds_there(holding: IdealArm) -> None:
    assert start(holding, MOVE) == []
    assert holding.controller.machine.cause == "start of move.csv by me"
    holding.run(1.0)
    assert holding.mode is Mode.TRACKING
    holding.run(2.5)
    assert holding.mode is Mode.HOLDING
    assert holding.controller.machine.cause == "move.csv came to its end"
    assert not holding.controller.machine.moving
    np.testing.assert_allclose(holding.decisions[-1].reference, [0.5, -0.2], atol=1e-9)
    holding.run(1.0)
    np.testing.assert_allclose(holding.q, [0.5, -0.2], atol=1e-4)
    assert never_jumped(holding)


def test_it_is_refused_where_the_arm_does_not_stand_at_its_beginning(holding: IdealArm) -> None:
    elsewhere = recorded([0.0, 0.16, 0.0], [1.0, 0.2, 0.0])
    assert start(holding, elsewhere) == [
        "a stands at 0.100 rad, 0.060 rad from where move.csv begins (0.160; allowed 0.05)",
        "`contactctl go a=0.160` leads there, or start it with --from-here "
        "(the configured one: trajectory.from_here)",
    ]
    assert holding.mode is Mode.HOLDING
    assert start(holding, recorded([0.0, 0.16, 0.0], [1.0, 0.2, 0.0], from_here=True)) == []
    holding.run(3.0)
    np.testing.assert_allclose(holding.q[0], 0.14, atol=1e-4)


def test_from_here_it_must_fit_between_the_limits(holding: IdealArm) -> None:
    far = recorded([0.0, -0.8, 0.0], [2.0, 0.15, 0.0], from_here=True)
    assert start(holding, far) == [
        "from 0.100 rad the path of a would leave its limits [-1, 1]",
        "`contactctl go a=0.030` leads there",
    ]


def test_a_path_that_fits_nowhere_has_no_way_there(holding: IdealArm) -> None:
    holding.controller.motion.limits = replace(LIMITS, lower=np.full(2, -0.3))
    far = recorded([0.0, -0.9, 0.0], [4.0, 0.6, 0.0], from_here=True)
    assert len(start(holding, far)) == 1


def test_paused_it_goes_on_and_stopped_it_begins_anew(holding: IdealArm) -> None:
    assert start(holding, MOVE) == []
    holding.run(1.0)
    holding.request(Event.PAUSE)
    holding.run(0.6)
    assert holding.mode is Mode.HOLDING
    assert holding.controller.machine.trajectory == "paused"
    s = holding.controller.motion.follower.place.s
    assert s > 0.4
    assert start(holding) == []
    assert holding.controller.machine.cause == f"start of move.csv at {s:.1f} s by me"
    holding.run(0.1)
    assert s < holding.controller.motion.follower.place.s < s + 0.1
    holding.request(Event.STOP)
    holding.run(0.6)
    assert holding.controller.machine.trajectory == "ready"
    assert start(holding) == []
    assert holding.controller.machine.cause == "start of sinusoids by me"


def test_a_refused_start_leaves_what_was_paused(holding: IdealArm) -> None:
    start(holding, MOVE)
    holding.run(1.0)
    holding.request(Event.PAUSE)
    holding.run(0.6)
    s = holding.controller.motion.follower.place.s
    assert start(holding, recorded([0.0, 0.9, 0.0], [1.0, 0.8, 0.0]))
    assert holding.controller.machine.trajectory == "paused"
    assert start(holding) == []
    assert holding.controller.motion.follower.place.s == s


def test_paused_while_guided_it_goes_on_with_start(tracking: IdealArm) -> None:
    tracking.touch()
    assert tracking.controller.machine.trajectory == "interrupted"
    s = tracking.controller.motion.follower.place.s
    tracking.request(Event.PAUSE)
    tracking.run(2.1)
    assert tracking.mode is Mode.HOLDING
    assert start(tracking) == []
    assert tracking.controller.motion.follower.place.s == s


def test_guided_a_recorded_trajectory_goes_on_as_displacements(holding: IdealArm) -> None:
    start(holding, MOVE)
    holding.run(1.0)
    holding.controller.arm("me")
    holding.touch()
    holding.run(0.5, **holding.push(0.6))
    holding.run(2.1)
    assert holding.mode is Mode.TRACKING
    left, s = holding.q[0], holding.controller.motion.follower.place.s
    holding.run(3.0)
    assert holding.mode is Mode.HOLDING
    way = MOVE.offset(2.0)[0] - MOVE.offset(s)[0]
    assert holding.q[0] == pytest.approx(left + way, abs=1e-2)


def test_the_finding_behind_a_mode_is_known_as_long_as_it_lasts(unarmed: IdealArm) -> None:
    hold, stop = Finding(Condition.OVERRUN, figures="30 ms"), Finding(Condition.DRIVE_FAULT, "b")
    assert unarmed.controller.finding is None
    unarmed.step(findings=(hold,))
    unarmed.run(1.0)
    assert unarmed.mode is Mode.HOLDING
    assert unarmed.controller.finding is hold, "it holds for what it stopped for"
    unarmed.step(findings=(stop,))
    unarmed.step(findings=(Finding(Condition.EMERGENCY, "a"),))
    assert unarmed.controller.finding is stop, "what came later did not stop it"
    assert unarmed.request(Event.RESET) == []
    assert unarmed.controller.finding is None
