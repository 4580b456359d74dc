"""From samples to findings."""

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
) -> list[tuple[Condition, str]]:
    return [(f.condition, f.text) for f in detector.findings(taken, mode, **seen)]


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
    return FaultDetector(
        JOINTS, settings, plausibility, Following(following, T), IgnoredSetpoints(two)
    )


@pytest.mark.parametrize("mode", sorted(SENSING))
def test_an_undisturbed_tick_finds_nothing(detector: FaultDetector, mode: Mode) -> None:
    for _ in range(3):
        assert detect(detector, samples(), mode, residual=np.zeros(2), gaps=np.full(2, T)) == []


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


def in_turn(
    detector: FaultDetector, ticks: int, mode: Mode = Mode.TRACKING, **how: object
) -> list[list[tuple[Condition, str]]]:
    """Each drive misses every other tick: none is stale, and no tick has all of them."""
    found = []
    for k in range(ticks):
        fresh = (k % 2 == 0, k % 2 == 1)
        taken = samples(fresh=fresh, age=(0, 1) if fresh[0] else (1, 0))
        found.append(detect(detector, taken, mode, **how))
    return found


def missing_in(detector: FaultDetector, pattern: str, ticks: int, **how: object) -> list[Condition]:
    """The elbow's sample is missing where the pattern has an x; the last condition of each tick."""
    found, age = [], 0
    for k in range(ticks):
        age = age + 1 if pattern[k % len(pattern)] == "x" else 0
        taken = samples(fresh=(True, not age), age=(0, age))
        found.append(next(iter(reversed(detect(detector, taken, **how))), (None, ""))[0])
    return found


@pytest.mark.parametrize("left_out", [0, 1])
def test_drives_that_fail_in_turn_are_bridged(detector: FaultDetector, left_out: int) -> None:
    for these in in_turn(detector, 60, left_out=left_out):
        assert these[-1][0] is Condition.SAMPLE_MISSING


@pytest.mark.parametrize(
    ("pattern", "stale_after"), [("x.", None), ("xx...", None), ("xx.", 23), ("xx.x.", 37)]
)
def test_a_drive_that_is_missing_in_most_ticks_is_stale(
    detector: FaultDetector, pattern: str, stale_after: int | None
) -> None:
    found = missing_in(detector, pattern, 120)
    expected = None if stale_after is None else stale_after - 1
    assert (found.index(Condition.STALE) if Condition.STALE in found else None) == expected


def test_one_tick_with_all_samples_wipes_nothing(detector: FaultDetector) -> None:
    missing_in(detector, "xx.", 22)
    missing_in(detector, ".", 3)
    assert Condition.STALE in missing_in(detector, "xx.", 13)


def test_after_a_reset_missing_samples_count_anew(detector: FaultDetector) -> None:
    missing_in(detector, "xx.", 22, mode=Mode.FAULTED)
    assert Condition.STALE not in missing_in(detector, "xx.", 22)


# Which joints sense, tick by tick: no elbow is an x.
@pytest.mark.parametrize(
    ("pattern", "deaf_after"), [("x", 5), ("x.", 17), ("xx.", 8), ("x..", None), (".", None)]
)
def test_an_arm_that_senses_nothing_somewhere_holds(
    detector: FaultDetector, pattern: str, deaf_after: int | None
) -> None:
    found = [
        detect(detector, samples(), sensing=np.array([True, pattern[k % len(pattern)] != "x"]))
        for k in range(60)
    ]
    deaf = [k + 1 for k, these in enumerate(found) if these]
    assert (deaf[0] if deaf else None) == deaf_after
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
    deaf = [any(condition is Condition.NOT_SENSING for condition, _ in each) for each in found]
    assert any(deaf) is holds
    assert deaf == sorted(deaf), "it does not come and go"
    if holds:
        for _ in range(198):
            assert detect(detector, taken["."])
        assert not detect(detector, taken["."]), "it is lifted"


def test_a_residual_that_begins_anew_again_and_again_is_deaf(detector: FaultDetector) -> None:
    """Three ticks of sixteen without samples, the others on their way up from zero."""
    found = [
        detect(detector, samples(), sensing=np.array([True, k % 16 > 2]), settled=False)
        for k in range(40)
    ]
    assert next(k for k, these in enumerate(found) if these) == 17


@pytest.mark.parametrize("mode", sorted(set(Mode) - SENSING))
def test_where_nothing_is_to_be_sensed_it_is_no_fault(detector: FaultDetector, mode: Mode) -> None:
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
    overrun = [k + 1 for k, these in enumerate(found) if (Condition.OVERRUN, "") in these]
    assert (overrun[0] if overrun else None) == overrun_after


def test_deadlines_missed_at_once_are_an_overrun_too(detector: FaultDetector) -> None:
    assert detect(detector, samples(), lateness_s=0.042, left_out=4) == [(Condition.LATE, "")]
    for _ in range(8):
        assert detect(detector, samples()) == []
    assert detect(detector, samples(), lateness_s=0.052, left_out=5) == [(Condition.OVERRUN, "")]


def test_a_daemon_that_was_absent_is_the_cause_of_what_waited_for_it(
    detector: FaultDetector,
) -> None:
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


def test_what_cannot_be_true_is_found_with_its_figures(detector: FaultDetector) -> None:
    assert detect(detector, samples(), residual=np.zeros(2), gaps=np.full(2, T)) == []
    found = detector.findings(
        samples(), Mode.TRACKING, residual=np.array([0.0, -5.5]), gaps=np.full(2, T)
    )
    assert found == (Finding(Condition.RESIDUAL_LIMIT, "elbow"),)
    assert str(found[0]) == "residual implausible: elbow (5.5 Nm, at most 5.0)"


def test_samples_are_compared_joint_by_joint_over_the_time_since_the_last(
    detector: FaultDetector,
) -> None:
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

    def ticks(mode: Mode) -> list[tuple[Condition, str]]:
        for _ in range(5):
            found = detect(detector, full, mode, residual=np.zeros(2), gaps=np.full(2, T))
        return found

    assert ticks(Mode.ADMITTANCE) == []
    # Nor does it hide anything else.
    torques = np.array([0.0, 5.5])
    found = detect(detector, full, Mode.ADMITTANCE, residual=torques, gaps=np.full(2, T))
    assert found == [(Condition.RESIDUAL_LIMIT, "elbow")]
    assert ticks(Mode.TRACKING) == [(Condition.TORQUE_SATURATED, "shoulder")]


def test_a_motor_that_does_not_follow_is_named_where_it_should(detector: FaultDetector) -> None:
    astray = (Condition.NOT_FOLLOWING, "elbow")

    def ticks(mode: Mode, count: int) -> list[tuple[Condition, str]]:
        for _ in range(count):
            found = detect(
                detector,
                samples(),
                mode,
                setpoint=np.array([0.0, 0.5]),
                residual=np.zeros(2),
                gaps=np.full(2, T),
            )
        return found

    assert ticks(Mode.FAULTED, 2 * TICKS) == ticks(Mode.ENABLING, 2 * TICKS) == []
    # Six setpoints old are those that it may still obey.
    assert ticks(Mode.TRACKING, TICKS + 4) == []
    assert ticks(Mode.TRACKING, 1) == [astray]
    assert ticks(Mode.OFF, 1) == []
    assert ticks(Mode.HOLDING, TICKS + 4) == []
    assert ticks(Mode.HOLDING, 1) == [astray]


def test_every_motor_that_does_not_follow_is_named_with_its_figures(
    detector: FaultDetector,
) -> None:
    for _ in range(TICKS + 5):
        found = detector.findings(
            samples(),
            Mode.TRACKING,
            setpoint=np.array([0.3, -0.5]),
            residual=np.zeros(2),
            gaps=np.full(2, T),
        )
    assert [str(finding) for finding in found] == [
        "drive does not follow: shoulder (by 0.300 rad/s, at most 0.200)",
        "drive does not follow: elbow (by 0.500 rad/s, at most 0.200)",
    ]


def test_after_a_reset_what_is_now_is_believed(detector: FaultDetector) -> None:
    def at(q: float, mode: Mode) -> list[tuple[Condition, str]]:
        return detect(detector, samples(q=(q, 0.0)), mode, residual=np.zeros(2), gaps=np.full(2, T))

    assert at(0.0, Mode.TRACKING) == []
    assert (Condition.APART, "shoulder") in at(1.0, Mode.TRACKING)
    assert at(1.0, Mode.FAULTED) == [(Condition.APART, "shoulder")]  # it stays until the reset
    assert at(1.0, Mode.OFF) == []
    assert at(1.0, Mode.OFF) == []


def test_everything_at_once_is_listed(detector: FaultDetector) -> None:
    taken = samples(
        Event(Kind.SILENT, "elbow"), fresh=(True, False), age=(0, 9), conditions=(FAILED, ON)
    )
    findings = detector.findings(
        taken,
        Mode.TRACKING,
        lateness_s=0.012,
        left_out=1,
        finite=False,
        residual=np.array([9.0, 0.0]),
        gaps=np.full(2, T),
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
