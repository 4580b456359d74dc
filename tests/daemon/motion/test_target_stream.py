"""Stream of targets: its phases, and what reaches the arm of targets that no arm can follow."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from daemon.modes.table import Mode
from daemon.motion.path import PathPoint
from daemon.motion.playout import Target
from daemon.motion.target_stream import (
    BRAKED_S,
    ENDED_S,
    STALLED_S,
    AfterContact,
    Phase,
    StreamSettings,
    TargetStream,
    next_phase,
)
from tests.ideal_arm import LIMITS, ideal_arm

DT = 0.01
REACH = 0.5
J, F, S, W = Phase.JOINING, Phase.FOLLOWING, Phase.STALLED, Phase.WAITING


def stream(after: AfterContact = AfterContact.HOLD, *first: float) -> TargetStream:
    settings = StreamSettings(after, REACH, join_velocity=0.2)
    made = TargetStream("me", settings, LIMITS, Target(0, 0.0, np.array(first or (0.0, 0.0))))
    made.go_on(np.zeros(2), again=False)
    return made


class Sender:
    """Sender of one target a tick to an arm that is where its reference is."""

    def __init__(self, to: TargetStream) -> None:
        self.to, self.number = to, 0
        self.q, self.velocity = np.zeros(2), np.zeros(2)

    def send(self, *q: float, ticks: int = 1) -> np.ndarray:
        """Send the same pose for some ticks; returns the last reference."""
        for _ in range(ticks):
            self.number += 1
            self.to.put(Target(self.number, self.number * DT, np.array(q)))
            self.silence()
        return self.q

    def silence(self, ticks: int = 1) -> np.ndarray:
        for _ in range(ticks):
            self.to.tick(DT)
            last = self.to.reference(self.q, self.velocity, DT)
            self.q, self.velocity = last.q, last.velocity
        return self.q


NEAR, OFF, FAR = 0.01, 0.3, 0.6  # from the target [rad]


@pytest.mark.parametrize(
    ("phase", "silent", "apart", "after"),
    [
        (J, False, OFF, J),
        (J, False, NEAR, F),
        (J, True, NEAR, S),
        (J, False, FAR, W),
        (F, False, OFF, F),
        (F, False, NEAR, F),
        (F, True, NEAR, S),
        (F, False, FAR, W),
        (S, True, NEAR, S),
        (S, False, NEAR, F),
        (S, False, 0.1, F),  # it moved on while nothing came
        (S, False, OFF, J),
        (S, False, FAR, W),
        (W, False, OFF, W),
        (W, False, NEAR, J),
        (W, True, NEAR, W),
        (W, False, FAR, W),
    ],
)
def test_phases(phase: Phase, silent: bool, apart: float, after: Phase) -> None:
    assert next_phase(phase, silent=silent, apart=apart, newest=apart, reach=REACH) is after


@pytest.mark.parametrize(
    ("phase", "newest", "after"),
    [(W, OFF, W), (W, NEAR, J), (J, OFF, J), (J, 0.1, F), (S, OFF, J), (F, OFF, F)],
)
def test_a_stream_that_jumps_across_the_arm_is_not_near_it(
    phase: Phase, newest: float, after: Phase
) -> None:
    assert next_phase(phase, silent=False, apart=NEAR, newest=newest, reach=REACH) is after


def test_a_rejoin_that_is_asked_for_during_the_contact_counts_after_it_once() -> None:
    made = stream()
    for k, phase in enumerate((J, W)):
        made.tick(DT)
        if k == 0:
            made.rejoin(interrupted=True)
        made.go_on(np.array([0.3, 0.0]), again=True)
        assert made.phase is phase


@pytest.mark.parametrize("velocity", [None, np.array([0.0, 9.0])])
def test_a_stream_that_is_faster_than_the_limits_counts_as_bounded(
    velocity: np.ndarray | None,
) -> None:
    made, slow = stream(), stream()
    for k in range(1, 20):
        made.put(Target(k, k * DT, np.array([0.0, 0.02 * (k % 10)]), velocity))
        slow.put(Target(k, k * DT, np.array([0.0, 0.01 * k])))
        made.tick(DT)
        slow.tick(DT)
    assert made.bounded > 5
    assert slow.bounded == 0


def test_it_joins_slowly_and_then_follows() -> None:
    made = stream()
    sender, before = Sender(made), np.zeros(2)
    for _ in range(100):
        q = sender.send(0.4, -0.1)
        assert made.phase is not Phase.JOINING or np.abs(q - before).max() <= 0.2 * DT * 1.2
        before = q
    sender.send(0.4, -0.1, ticks=200)
    assert made.phase is Phase.FOLLOWING
    np.testing.assert_allclose(sender.send(0.4, -0.1), [0.4, -0.1], atol=1e-3)


def test_silence_brakes_it_and_a_target_takes_it_on() -> None:
    made = stream()
    sender = Sender(made)
    for k in range(100):
        sender.send(0.3 * math.sin(0.03 * k), 0.0)
    sender.silence(math.ceil(STALLED_S / DT) + 1)
    assert made.phase is Phase.STALLED
    sender.silence(25)
    stands = sender.silence()
    assert (stands == sender.silence(3)).all()
    assert not made.ended
    sender.number += 40  # it sent on, while nothing came
    sender.send(float(stands[0]) + 0.02, 0.0, ticks=200)
    assert made.phase is Phase.FOLLOWING
    sender.silence(math.ceil(ENDED_S / DT) + 1)
    assert made.ended


def test_two_lost_targets_at_20_hz_brake_it_for_a_moment_and_are_no_stall() -> None:
    made = stream()
    sender = Sender(made)
    for k in range(100):
        sender.send(0.3 * math.sin(0.03 * k), 0.0)
    sender.silence(math.ceil(BRAKED_S / DT))
    moved = abs(sender.velocity[0])
    sender.silence()
    assert made.phase is Phase.FOLLOWING
    assert abs(sender.velocity[0]) == pytest.approx(moved - LIMITS.acceleration[0] * DT)
    sender.number += 15
    sender.send(0.3 * math.sin(0.03 * 116), 0.0, ticks=30)
    assert made.phase is Phase.FOLLOWING


def test_an_arm_that_lags_behind_stands_in_time_and_is_not_led_on() -> None:
    """A position loop leads an arm that is behind its reference on to it, long after the last
    target."""
    made, motion = stream(), ideal_arm().controller.motion
    motion.follower.place = PathPoint(made)
    motion.follow(np.zeros(2))
    q, moves, push = np.zeros(2), np.zeros(2), np.zeros(2)
    after = []  # setpoints after the last target
    for k in range(240):
        if k < 200:
            made.put(Target(k + 1, (k + 1) * DT, np.array([0.3 * math.sin(0.03 * k), 0.0])))
        made.tick(DT)
        motion.step(Mode.TRACKING, q, None, push, DT)
        moves = moves + 0.2 * (motion.velocity - moves)  # a lag of 0.05 s
        q = q + moves * DT
        after += [float(motion.velocity[0])] if k >= 200 else []
    braked = math.ceil(BRAKED_S / DT)
    stands = braked + math.ceil(abs(after[braked - 1]) / LIMITS.acceleration[0] / DT)
    assert min(np.abs(after[braked : stands + 2])) < 0.005


def test_after_a_contact_it_waits_for_the_stream_or_goes_there() -> None:
    for after, phase in ((AfterContact.HOLD, W), (AfterContact.REJOIN, J)):
        made = stream(after)
        sender = Sender(made)
        sender.send(0.0, 0.0, ticks=50)
        made.go_on(np.array([0.3, 0.0]), again=True)
        q = sender.send(0.0, 0.0, ticks=40)
        assert made.phase is phase
        assert (q[0] == 0.3) == (phase is W)
    made = stream()
    sender = Sender(made)
    sender.send(0.0, 0.0, ticks=50)
    made.go_on(np.array([0.3, 0.0]), again=True)
    assert sender.send(0.0, 0.0, ticks=40)[0] == 0.3
    made.rejoin(interrupted=False)
    assert sender.send(0.0, 0.0, ticks=300)[0] == pytest.approx(0.0, abs=1e-3)


def test_a_target_out_of_reach_is_not_gone_to() -> None:
    made = stream()
    sender = Sender(made)
    sender.send(0.0, 0.0, ticks=50)
    q = sender.send(0.9, 0.0, ticks=200)
    assert made.phase is Phase.WAITING
    assert abs(q[0]) < 0.1


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_targets_that_are_no_numbers_are_left_out(bad: float) -> None:
    made = stream()
    sender = Sender(made)
    sender.send(0.1, 0.0, ticks=10)
    made.put(Target(99, 1.0, np.array([bad, 0.0])))
    made.put(Target(99, bad, np.zeros(2)))
    made.put(Target(99, 1.0, np.zeros(2), np.array([0.0, bad])))
    assert made.refused == 3
    assert made.playout.newest.q[0] == 0.1


def test_targets_beyond_the_joint_limits_are_moved_to_them() -> None:
    made = stream()
    made.put(Target(1, 0.01, np.array([7.0, -7.0]), np.array([9.0, 0.0])))
    assert made.bounded == 1
    np.testing.assert_array_equal(made.playout.newest.q, [1.0, -1.0])


@given(
    st.lists(
        st.tuples(
            st.integers(-2, 3), st.floats(-0.1, 0.2), st.floats(-9.0, 9.0), st.integers(0, 9)
        ),
        max_size=60,
    )
)
@example([(1, 2.2e-311, 1.0, 0)])  # overflowed
def test_no_stream_makes_the_reference_jump(
    arrivals: list[tuple[int, float, float, int]],
) -> None:
    made, before, velocity = stream(), np.zeros(2), np.zeros(2)
    number, sent_s = 0, 0.0
    for count, elapsed_s, q, ticks in arrivals:
        number, sent_s = number + count, sent_s + elapsed_s
        made.put(Target(number, sent_s, np.array([q, -q])))
        for _ in range(ticks):
            made.tick(DT)
            reference = made.reference(before, velocity, DT)
            assert (np.abs(reference.q - before) <= 1.3 * LIMITS.velocity * DT).all()
            before, velocity = reference.q, reference.velocity
