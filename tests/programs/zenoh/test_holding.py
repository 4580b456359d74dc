"""Hold: the caller that keeps the arm armed, the length of its lease, and its release."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from programs.zenoh.holding import (
    DRIFT,
    FIRST_CALL_S,
    HOLD_S,
    LEAST_S,
    MOST_FIRST_CALLS,
    MOST_LOST,
    ONCE,
    RELEASE_FIRST,
    ArmCall,
    Hold,
    Step,
    Verdict,
)

A, B = b"a" * 16, b"b" * 16
AHEAD_S = 1.7e9  # of the caller's clock before ours


def say(
    hold: Hold, now_s: float, caller: bytes = A, *, armed: bool = True, late_s: float = 0.0
) -> Verdict:
    """Result of a call that was sent `late_s` before it is looked at; the daemon does it."""
    request = ArmCall(caller, armed, AHEAD_S + now_s - late_s)
    verdict = hold.judge(request, now_s)
    if verdict.step is Step.DISARM:
        hold.release(caller)
    elif verdict.step is not Step.NOTHING:
        hold.granted(request, verdict.lease_s, now_s)
    return verdict


def begin(hold: Hold, now_s: float, caller: bytes = A, *, late_s: float = 0.0) -> Verdict:
    """Result of the call that arms, after the one that does not yet."""
    first = say(hold, now_s - FIRST_CALL_S - 0.01, caller, late_s=late_s)
    return first if first.why != ONCE else say(hold, now_s, caller, late_s=late_s)


def test_the_first_call_arms_nothing_and_later_ones_arm_and_renew() -> None:
    hold = Hold()
    steps = [say(hold, 0.2 * i).step for i in range(5)]
    assert steps == [Step.NOTHING, Step.NOTHING, Step.ARM, Step.RENEW, Step.RENEW]


@pytest.mark.parametrize("faster", [0.0, 0.3, 0.8, 1.2, 3.0])
def test_delayed_calls_arm_nothing(faster: float) -> None:
    """A router that hung lets through what a caller sent that is gone: all at once, or in its own
    time."""
    hold = Hold()
    for i in range(50):
        verdict = say(hold, 100.0 + 0.2 * i * faster, late_s=100.0 + 0.2 * i * (faster - 1.0))
        assert (verdict.step, verdict.why) == (Step.NOTHING, ONCE)
    assert begin(hold, 200.0).step is Step.ARM  # of a caller that lives


def test_calls_too_far_apart_arm_nothing() -> None:
    hold = Hold()
    assert {say(hold, i * (HOLD_S + 0.01)).why for i in range(20)} == {ONCE}


def test_the_number_of_remembered_first_calls_is_bounded() -> None:
    hold = Hold()
    for i in range(2 * MOST_FIRST_CALLS):
        say(hold, float(i), i.to_bytes(16))
    assert len(hold._first_calls) == MOST_FIRST_CALLS


def test_no_other_caller_takes_over_the_hold() -> None:
    hold = Hold()
    begin(hold, 0.0)
    assert say(hold, HOLD_S - 0.01, B).why == "another client keeps it armed"
    assert begin(hold, 2.0, B).step is Step.ARM
    assert say(hold, 2.1, A).why == RELEASE_FIRST  # it was silent for too long


def test_a_caller_that_lost_the_hold_must_release_first() -> None:
    hold = Hold()
    begin(hold, 0.0)
    hold.lose()
    assert say(hold, 0.1).why == RELEASE_FIRST
    assert say(hold, 100.0).why == RELEASE_FIRST
    assert say(hold, 100.1, armed=False).step is Step.DISARM
    assert begin(hold, 101.0).step is Step.ARM


def test_any_caller_may_disarm_and_the_holder_loses_the_hold() -> None:
    hold = Hold()
    begin(hold, 0.0)
    assert say(hold, 0.1, B, armed=False).step is Step.DISARM
    assert say(hold, 0.2).why == RELEASE_FIRST
    assert begin(hold, 1.0, B).step is Step.ARM


def test_a_caller_that_released_may_arm_again() -> None:
    hold = Hold()
    begin(hold, 0.0)
    say(hold, 0.1, armed=False)
    assert begin(hold, 1.0).step is Step.ARM


def test_the_lease_is_shorter_by_the_delay_of_the_call() -> None:
    hold = Hold()
    begin(hold, 0.0, late_s=0.3)
    assert say(hold, 0.2, late_s=0.1).lease_s == pytest.approx(HOLD_S)  # its fastest
    assert say(hold, 0.4, late_s=0.6).lease_s == pytest.approx(HOLD_S - 0.5, abs=DRIFT)
    verdict = say(hold, 0.6, late_s=0.1 + HOLD_S)
    assert (verdict.step, verdict.why) == (Step.NOTHING, "0.8 s later than its fastest call")


@pytest.mark.parametrize("hertz", [5.0, 20.0, 200.0])
@pytest.mark.parametrize("let_through", [0.5, 0.8, 0.95, 0.99])
def test_a_delay_that_grows_is_detected(hertz: float, let_through: float) -> None:
    """A link that lets fewer calls through than are sent keeps ever more of them; their caller may
    be gone long before they are through."""
    hold = Hold()
    way_s, until_s, renewed = 0.0, 0.0, 0
    begin(hold, -0.1)
    for i in range(int(100.0 * hertz)):
        sent_s = i / hertz
        now_s = i / (hertz * let_through)
        way_s = now_s - sent_s
        verdict = say(hold, now_s, late_s=way_s)
        if verdict.step is Step.NOTHING:
            break
        renewed += 1
        until_s = now_s + verdict.lease_s
        assert until_s - sent_s < 1.0
    assert renewed > 1
    assert way_s > HOLD_S / 2  # what is short is borne


def test_drift_between_clocks_shortens_no_lease() -> None:
    hold = Hold()
    begin(hold, -0.2)
    for i in range(5 * 3600):
        now_s = 0.2 * i
        lease_s = say(hold, now_s, late_s=5e-4 * now_s).lease_s  # as a clock that is slewed
        assert lease_s == pytest.approx(HOLD_S)


def test_a_caller_that_renews_too_late_has_lost_the_hold() -> None:
    """As when the caller's clock is set back: its calls are late by that for ever."""
    hold = Hold()
    begin(hold, 0.0)
    assert say(hold, 0.2, late_s=60.0).why == "60.0 s later than its fastest call"
    assert say(hold, HOLD_S, late_s=60.0).why == RELEASE_FIRST
    say(hold, 1.0, late_s=60.0, armed=False)
    assert begin(hold, 2.0, late_s=60.0).step is Step.ARM


def test_the_number_of_remembered_losers_is_bounded() -> None:
    hold = Hold()
    for i in range(2 * MOST_LOST):
        begin(hold, 2.0 * i, i.to_bytes(16))
    assert len(hold._lost) == MOST_LOST


CALLS = st.tuples(
    st.sampled_from([A, B]), st.booleans(), st.floats(0.0, 0.5), st.floats(0.0, 2.0), st.booleans()
)


@given(st.lists(CALLS, max_size=40))
def test_no_lease_outlasts_the_caller(calls: list[tuple[bytes, bool, float, float, bool]]) -> None:
    """Whatever is said in whatever order: a lease ends HOLD_S after its call was sent, counted with
    the fastest way of those calls by which this caller has held it, and what clocks drift."""
    hold, now_s = Hold(), 0.0
    fastest: dict[bytes, float] = {}
    for caller, armed, apart_s, way_s, refused in calls:
        now_s += apart_s
        request = ArmCall(caller, armed, AHEAD_S + now_s - way_s)
        verdict = hold.judge(request, now_s)
        if verdict.why == ONCE:
            now_s += FIRST_CALL_S + 0.01
            request = ArmCall(caller, armed, AHEAD_S + now_s - way_s)
            verdict = hold.judge(request, now_s)
        if verdict.step is Step.DISARM:
            hold.release(caller)
        elif verdict.step is Step.ARM:
            assert verdict.lease_s == HOLD_S
            fastest[caller] = way_s
        elif verdict.step is Step.RENEW:
            fastest[caller] = min(fastest[caller], way_s)
            sent_s = now_s - way_s
            assert (
                now_s + verdict.lease_s <= sent_s + fastest[caller] + HOLD_S + DRIFT * now_s + 1e-6
            )
            assert verdict.lease_s >= LEAST_S
        if verdict.step in (Step.ARM, Step.RENEW):
            if refused:
                hold.lose()
            else:
                hold.granted(request, verdict.lease_s, now_s)
