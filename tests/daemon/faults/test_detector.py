"""Findings of a tick, from its samples."""

import numpy as np
import pytest

from daemon.faults.conditions import Condition, Response
from daemon.faults.detector import CONDITION_OF, DetectorSettings, FaultDetector
from daemon.faults.finding import Finding, strongest
from daemon.faults.following import TICKS, Following, FollowingSettings
from daemon.faults.ignored_setpoints import IgnoredSetpoints
from daemon.faults.plausibility import Plausibility, PlausibilitySettings
from daemon.faults.table import TABLE
from daemon.modes.table import SENSING, Mode
from drivers.api import DriveCondition, DriveStatus, Event, Kind, Samples

JOINTS = ("shoulder", "elbow")
T = 0.01
ON, FAILED, FAILING = DriveCondition.OPERATING, DriveCondition.FAILED, DriveCondition.FAILING
GAPS = np.full(2, T)  # time since the previous samples
JUDGED = {"residual": np.zeros(2), "gaps": GAPS}
Found = list[tuple[Condition, str]]


def status(condition: DriveCondition) -> DriveStatus:
    return DriveStatus(condition, condition.value, condition.value, False, following=False)


def samples(
    *events: Event,
    fresh: tuple[bool, bool] = (True, True),
    age: tuple[int, int] = (0, 0),
    starting: tuple[bool, bool] = (False, False),
    conditions: tuple[DriveCondition, DriveCondition] = (ON, ON),
    q: tuple[float, float] = (0.0, 0.0),
    current: tuple[float, float] = (0.0, 0.0),
) -> Samples:
    return Samples(
        np.array(current),
        np.array(q),
        np.zeros(2),
        None,
        np.array(fresh),
        np.array(age) * T,
        np.array(starting),
        tuple(map(status, conditions)),
        events,
    )


def detect(
    detector: FaultDetector, taken: Samples, mode: Mode = Mode.TRACKING, **seen: object
) -> Found:
    return [(f.condition, f.text) for f in detector.findings(taken, mode, **seen)]


def first(found: list[Found], condition: Condition) -> int | None:
    """Number of the first tick that found the condition."""
    return next((k for k, these in enumerate(found, 1) if condition in dict(these)), None)


@pytest.fixture
def detector() -> FaultDetector:
    two = np.ones(2)
    bounds = PlausibilitySettings(
        lower=-2.0 * two,
        upper=2.0 * two,
        speed=two,
        half_gap=0.0 * two,
        position_margin=0.05,
        current=two,
        residual=5.0 * two,
        saturated_ticks=3,
        motor_drift=0.001,
        motor_scale_error=0.002,
    )
    settings = DetectorSettings(T, stale_ticks=3, overrun_ticks=5)
    following = FollowingSettings(deviation=0.2 * two, current=two, lag_s=0.01)
    plausibility = Plausibility(JOINTS, bounds)
    followed, ignored = Following(following, T), IgnoredSetpoints(two)
    return FaultDetector(JOINTS, settings, plausibility, followed, ignored)


@pytest.mark.parametrize("mode", sorted(SENSING))
def test_an_undisturbed_tick_finds_nothing(detector: FaultDetector, mode: Mode) -> None:
    for _ in range(3):
        assert detect(detector, samples(), mode, **JUDGED) == []


@pytest.mark.parametrize("kind", [k for k in Kind if k not in (Kind.LOADED, Kind.DISTURBED)])
def test_an_event_of_the_bus_is_a_condition(detector: FaultDetector, kind: Kind) -> None:
    (found,) = detect(detector, samples(Event(kind, "elbow: words")))
    assert TABLE[found[0]].source is kind
    assert found[1] == "elbow: words"


def test_every_kind_of_event_leads_to_a_condition() -> None:
    assert set(CONDITION_OF) == set(Kind) - {Kind.DISTURBED}


def test_a_load_of_the_bus_is_shown_with_what_it_may_cause(detector: FaultDetector) -> None:
    events = (Event(Kind.LOADED, "90 %"), Event(Kind.SILENT, "elbow"), Event(Kind.ERROR, "hot"))
    assert [str(finding) for finding in detector.findings(samples(*events), Mode.TRACKING)] == [
        "bus loaded (90 %)",
        "heartbeat lost: elbow (90 %)",
        "emergency message: hot",
    ]


def test_a_disturbance_counts_when_it_lasts(detector: FaultDetector) -> None:
    words = "sending failed: No buffer space"
    trouble = samples(Event(Kind.DISTURBED, words))
    for _ in range(2):
        assert detect(detector, trouble) == [(Condition.BUS_DISTURBED, words)]
    for _ in range(2):
        assert detect(detector, trouble) == [(Condition.BUS_TROUBLE, words)]
    # A tick without one takes half of one away, not all.
    assert detect(detector, samples()) == []
    assert detect(detector, trouble)[0][0] is Condition.BUS_TROUBLE
    for _ in range(6):
        assert detect(detector, samples()) == []
    for _ in range(2):
        assert detect(detector, trouble)[0][0] is Condition.BUS_DISTURBED


@pytest.mark.parametrize(("pattern", "trouble"), [("110", True), ("10", True), ("100", False)])
def test_disturbances_that_come_and_go_are_trouble_too(
    detector: FaultDetector, pattern: str, trouble: bool
) -> None:
    found = set()
    for kind in pattern * 20:
        taken = samples(Event(Kind.DISTURBED, "no room")) if kind == "1" else samples()
        found |= {condition for condition, _ in detect(detector, taken)}
    assert (Condition.BUS_TROUBLE in found) is trouble


def test_missing_samples_are_named_and_stale_after_a_while(detector: FaultDetector) -> None:
    missing = samples(fresh=(True, False), age=(0, 2))
    assert detect(detector, missing) == [(Condition.SAMPLE_MISSING, "elbow")]
    missing = samples(fresh=(False, False), age=(1, 2))
    assert detect(detector, missing) == [(Condition.SAMPLE_MISSING, "shoulder, elbow")]
    stale = samples(fresh=(False, False), age=(1, 3))
    assert detect(detector, stale) == [(Condition.STALE, "nothing from elbow for 3 ticks")]


def test_a_drive_that_is_still_starting_is_not_stale(detector: FaultDetector) -> None:
    starting = samples(fresh=(True, False), age=(0, 30), starting=(False, True))
    for _ in range(30):
        assert detect(detector, starting) == [(Condition.SAMPLE_MISSING, "elbow")]
    late = samples(fresh=(True, False), age=(0, 31))
    assert detect(detector, late) == [(Condition.STALE, "nothing from elbow for 3 ticks")]


@pytest.mark.parametrize("left_out", [0, 1])
def test_samples_missing_in_turn_are_not_stale(detector: FaultDetector, left_out: int) -> None:
    """Each drive misses every other tick, and no tick has both samples."""
    for k in range(60):
        taken = samples(fresh=(k % 2 == 0, k % 2 == 1), age=(k % 2, 1 - k % 2))
        found = detect(detector, taken, left_out=left_out)
        assert found[-1][0] is Condition.SAMPLE_MISSING


def missing_in(detector: FaultDetector, pattern: str, ticks: int, **how: object) -> list[Found]:
    """Findings of ticks in which the elbow's sample is missing where the pattern has an x."""
    found, age = [], 0
    for k in range(ticks):
        age = age + 1 if pattern[k % len(pattern)] == "x" else 0
        found.append(detect(detector, samples(fresh=(True, not age), age=(0, age)), **how))
    return found


@pytest.mark.parametrize(
    ("pattern", "stale_after"), [("x.", None), ("xx...", None), ("xx.", 23), ("xx.x.", 37)]
)
def test_a_drive_that_is_missing_in_most_ticks_is_stale(
    detector: FaultDetector, pattern: str, stale_after: int | None
) -> None:
    assert first(missing_in(detector, pattern, 120), Condition.STALE) == stale_after


def test_three_ticks_with_all_samples_do_not_clear_the_count(detector: FaultDetector) -> None:
    missing_in(detector, "xx.", 22)
    missing_in(detector, ".", 3)
    assert first(missing_in(detector, "xx.", 13), Condition.STALE)


def test_missing_samples_count_anew_after_a_reset(detector: FaultDetector) -> None:
    missing_in(detector, "xx.", 22, mode=Mode.FAULTED)
    assert first(missing_in(detector, "xx.", 22), Condition.STALE) is None


@pytest.mark.parametrize(
    ("pattern", "after"), [("x", 5), ("x.", 17), ("xx.", 8), ("x..", None), (".", None)]
)
def test_a_joint_that_does_not_sense_contact_for_ticks_is_found(
    detector: FaultDetector, pattern: str, after: int | None
) -> None:
    """Tick by tick: the elbow does not sense where the pattern has an x."""
    found = [
        detect(detector, samples(), sensing=np.array([True, pattern[k % len(pattern)] != "x"]))
        for k in range(60)
    ]
    assert first(found, Condition.NOT_SENSING) == after
    assert all(these == [(Condition.NOT_SENSING, "elbow")] for these in found if these)


@pytest.mark.parametrize(
    ("pattern", "holds"), [("l.", True), ("b.", True), ("lb.", True), ("l..", False), ("m.", False)]
)
def test_late_answers_of_which_one_is_missing_are_late(
    detector: FaultDetector, pattern: str, holds: bool
) -> None:
    """l: all late; b: late, and one missing; m: one missing, the other prompt."""
    taken = {
        "l": samples(fresh=(False, False)),
        "b": samples(fresh=(False, False), age=(1, 0)),
        "m": samples(fresh=(False, True), age=(1, 0)),
        ".": samples(),
    }
    found = [detect(detector, taken[one]) for one in pattern * 250]
    doubted = [Condition.NOT_SENSING in dict(each) for each in found]
    assert any(doubted) is holds
    assert doubted == sorted(doubted), "it does not come and go"
    if holds:
        for _ in range(198):
            assert detect(detector, taken["."])
        assert not detect(detector, taken["."]), "it is lifted"


def test_a_residual_that_restarts_again_and_again_does_not_sense(detector: FaultDetector) -> None:
    """Three ticks of sixteen without samples, the others on their way up from zero."""
    found = [
        detect(detector, samples(), sensing=np.array([True, k % 16 > 2]), settled=False)
        for k in range(40)
    ]
    assert first(found, Condition.NOT_SENSING) == 18


@pytest.mark.parametrize("mode", sorted(set(Mode) - SENSING))
def test_modes_without_sensing_find_no_fault(detector: FaultDetector, mode: Mode) -> None:
    for _ in range(20):
        assert detect(detector, samples(), mode, sensing=np.zeros(2, dtype=bool)) == []


def test_a_late_machine_excuses_stale_samples_for_a_while(detector: FaultDetector) -> None:
    starved = (Condition.STARVED, "nothing from elbow for 3 ticks")
    stale = (Condition.STALE, "nothing from elbow for 3 ticks")

    def found(age: int, left_out: int = 0) -> tuple[Condition, str]:
        taken = samples(fresh=(True, False), age=(0, age))
        return detect(detector, taken, left_out=left_out)[-1]

    assert found(3, left_out=1) == starved
    assert found(4) == found(5) == starved  # it came late two ticks ago
    assert found(6) == stale  # three
    assert found(8, left_out=1) == starved
    assert found(9, left_out=1) == stale  # three times as long as the drives alone may


@pytest.mark.parametrize("mode", Mode)
def test_a_drive_in_fault_is_found_in_every_mode(detector: FaultDetector, mode: Mode) -> None:
    for condition in (FAILED, FAILING):
        taken = samples(conditions=(ON, condition))
        assert detect(detector, taken, mode) == [(Condition.DRIVE_FAULT, "elbow")]


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("condition", [c for c in DriveCondition if c not in (ON, FAILED, FAILING)])
def test_a_drive_that_drops_out_is_found_while_it_should_run(
    detector: FaultDetector, mode: Mode, condition: DriveCondition
) -> None:
    text = f"shoulder is in {condition.value}"
    expected = [(Condition.DRIVE_DROPPED, text)] if mode in SENSING else []
    assert detect(detector, samples(conditions=(condition, ON)), mode) == expected


@pytest.mark.parametrize(
    ("left_out", "overrun_after"),
    [([1], 5), ([1, 0, 0], None), ([1, 0], 17), ([2, 0], 5), ([2, 0, 0], 10), ([3, 0, 0], 4)],
)
def test_missed_deadlines_become_an_overrun_where_two_ticks_on_time_make_up_for_one(
    detector: FaultDetector, left_out: list[int], overrun_after: int | None
) -> None:
    found = [
        detect(detector, samples(), lateness_s=0.012, left_out=left_out[k % len(left_out)])
        for k in range(60)
    ]
    assert first(found, Condition.OVERRUN) == overrun_after


def test_deadlines_missed_at_once_are_an_overrun_too(detector: FaultDetector) -> None:
    assert detect(detector, samples(), lateness_s=0.042, left_out=4) == [(Condition.LATE, "")]
    for _ in range(8):
        assert detect(detector, samples()) == []
    assert detect(detector, samples(), lateness_s=0.052, left_out=5) == [(Condition.OVERRUN, "")]


def test_an_absent_daemon_is_the_cause_of_what_it_missed(detector: FaultDetector) -> None:
    waited = samples(
        Event(Kind.ABSENT, "for 400 ms"),
        Event(Kind.UNHEARD, "shoulder"),
        fresh=(False, True),
        age=(9, 0),
        conditions=(ON, FAILED),
    )
    found = detector.findings(waited, Mode.TRACKING, lateness_s=0.4, left_out=40, finite=False)
    assert {f.response for f in found} == {Response.HOLD, Response.QUICK_STOP}
    assert strongest(found) == Finding(Condition.ABSENT, "for 400 ms")
    assert len(found) == 6


def test_estimates_that_are_not_finite(detector: FaultDetector) -> None:
    assert detect(detector, samples(), finite=False) == [(Condition.NOT_FINITE, "in the estimate")]


def test_an_implausible_residual_is_found_with_its_figures(detector: FaultDetector) -> None:
    assert detect(detector, samples(), **JUDGED) == []
    torques = np.array([0.0, -5.5])
    found = detector.findings(samples(), Mode.TRACKING, residual=torques, gaps=GAPS)
    assert found == (Finding(Condition.RESIDUAL_LIMIT, "elbow"),)
    assert str(found[0]) == "residual implausible: elbow (5.5 Nm, at most 5.0)"


def test_samples_are_compared_over_the_time_since_each_joints_last(detector: FaultDetector) -> None:
    def jumps(q: float, *gaps: float) -> bool:
        taken = samples(q=(0.0, q), fresh=(True, gaps[1] > 0.0))
        these = detect(detector, taken, residual=np.zeros(2), gaps=np.array(gaps))
        return (Condition.JUMP, "elbow") in these

    assert not jumps(0.0, T, T)
    assert not jumps(0.0, T, 0.0)
    assert not jumps(0.065, T, 2 * T)  # 1 rad/s for two ticks, and 0.05 rad of play
    assert jumps(0.0, T, T)
    assert detect(detector, samples(q=(0.0, 1.0))) == [], "before there is an estimate"


def test_a_hand_that_leads_the_arm_may_be_stronger_than_a_motor(detector: FaultDetector) -> None:
    full = samples(current=(1.0, 0.0))

    def ticks(mode: Mode) -> Found:
        return [detect(detector, full, mode, **JUDGED) for _ in range(5)][-1]

    assert ticks(Mode.ADMITTANCE) == []
    # Nor does it hide anything else.
    found = detect(detector, full, Mode.ADMITTANCE, residual=np.array([0.0, 5.5]), gaps=GAPS)
    assert found == [(Condition.RESIDUAL_LIMIT, "elbow")]
    assert ticks(Mode.TRACKING) == [(Condition.TORQUE_SATURATED, "shoulder")]


def test_a_motor_that_does_not_follow_is_named_while_commanded(detector: FaultDetector) -> None:
    not_followed = [(Condition.NOT_FOLLOWING, "elbow")]
    setpoint = np.array([0.0, 0.5])

    def ticks(mode: Mode, count: int) -> Found:
        for _ in range(count):
            found = detect(detector, samples(), mode, setpoint=setpoint, **JUDGED)
        return found

    assert ticks(Mode.FAULTED, 2 * TICKS) == ticks(Mode.ENABLING, 2 * TICKS) == []
    # Six setpoints old are those that it may still obey.
    assert ticks(Mode.TRACKING, TICKS + 4) == []
    assert ticks(Mode.TRACKING, 1) == not_followed
    assert ticks(Mode.OFF, 1) == []
    assert ticks(Mode.HOLDING, TICKS + 4) == []
    assert ticks(Mode.HOLDING, 1) == not_followed


def test_each_motor_that_does_not_follow_is_named_with_figures(detector: FaultDetector) -> None:
    setpoint = np.array([0.3, -0.5])
    for _ in range(TICKS + 5):
        found = detector.findings(samples(), Mode.TRACKING, setpoint=setpoint, **JUDGED)
    assert [str(finding) for finding in found] == [
        "drive does not follow: shoulder (by 0.300 rad/s, at most 0.200)",
        "drive does not follow: elbow (by 0.500 rad/s, at most 0.200)",
    ]


def test_a_reset_takes_the_present_positions_as_right(detector: FaultDetector) -> None:
    def at(q: float, mode: Mode) -> Found:
        return detect(detector, samples(q=(q, 0.0)), mode, **JUDGED)

    assert at(0.0, Mode.TRACKING) == []
    assert (Condition.APART, "shoulder") in at(1.0, Mode.TRACKING)
    assert at(1.0, Mode.FAULTED) == [(Condition.APART, "shoulder")]  # it stays until the reset
    assert at(1.0, Mode.OFF) == at(1.0, Mode.OFF) == []


def test_everything_at_once_is_listed(detector: FaultDetector) -> None:
    silent = Event(Kind.SILENT, "elbow")
    taken = samples(silent, fresh=(True, False), age=(0, 9), conditions=(FAILED, ON))
    findings = detector.findings(
        taken,
        Mode.TRACKING,
        lateness_s=0.012,
        left_out=1,
        finite=False,
        residual=np.array([9.0, 0.0]),
        gaps=GAPS,
    )
    assert [f.condition for f in findings] == [
        Condition.LATE,
        Condition.HEARTBEAT_LOST,
        Condition.STALE,
        Condition.DRIVE_FAULT,
        Condition.NOT_FINITE,
        Condition.RESIDUAL_LIMIT,
    ]
    assert max(f.response for f in findings) is Response.QUICK_STOP
