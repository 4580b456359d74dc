"""Stream of targets through the modes: touched, halted, silent, and with targets of all kinds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.faults.plausibility import STANDSTILL_SPEED
from daemon.modes.contact_reactions import AfterQuiet
from daemon.modes.table import Event, Mode
from daemon.motion.playout import Target
from daemon.motion.target_stream import AfterContact, Phase, StreamSettings, TargetStream
from tests.ideal_arm import LIMITS, IdealArm, T, holding_arm


class Streamed:
    """Arm that follows a stream of one target a tick, which stands where the arm stood."""

    def __init__(
        self, after: AfterContact = AfterContact.HOLD, quiet: AfterQuiet = AfterQuiet.RESUME
    ) -> None:
        self.arm: IdealArm = holding_arm(after_quiet=quiet)
        settings = StreamSettings(after, 0.5, join_velocity=0.2)
        self.q = self.arm.q.copy()
        self.stream = TargetStream("a leader", settings, LIMITS, Target(0, 0.0, self.q))
        self.number = 0
        assert self.arm.controller.request(Event.START, "me", self.arm.time_s, self.stream) == []
        self.run(0.5)

    def send(self) -> None:
        self.number += 1
        self.stream.put(Target(self.number, self.number * T, self.q.copy()))

    def run(self, seconds: float, **seen: object) -> None:
        for _ in range(round(seconds / T)):
            self.send()
            self.arm.step(**seen)

    def guided(self) -> None:
        """A hand leads the arm away from the stream, and leaves."""
        assert self.arm.controller.arm("me") == []
        self.run(1.0, **self.arm.push(0.4))
        assert self.arm.mode is Mode.ADMITTANCE
        self.run(2.1)


@pytest.fixture
def streamed() -> Streamed:
    return Streamed()


def test_the_arm_follows_and_ends_nowhere(streamed: Streamed) -> None:
    for k in range(400):
        streamed.q[0] = 0.1 + 0.2 * np.sin(0.02 * k)
        streamed.run(T)
    assert streamed.arm.mode is Mode.TRACKING
    assert streamed.stream.phase is Phase.FOLLOWING
    assert streamed.arm.q[0] == pytest.approx(0.1 + 0.2 * np.sin(0.02 * 395), abs=0.02)


@pytest.mark.parametrize("quiet", AfterQuiet)
def test_after_a_contact_it_holds_until_the_stream_comes_back(quiet: AfterQuiet) -> None:
    streamed = Streamed(quiet=quiet)
    streamed.guided()
    arm = streamed.arm
    assert (arm.mode, streamed.stream.phase) == (Mode.TRACKING, Phase.WAITING)
    stands = arm.q.copy()
    streamed.run(3.0)
    np.testing.assert_allclose(arm.q, stands, atol=1e-3)
    assert abs(stands[0] - streamed.q[0]) > 0.1
    streamed.q = stands + 0.01
    streamed.run(1.0)
    assert streamed.stream.phase is Phase.FOLLOWING
    np.testing.assert_allclose(arm.q, streamed.q, atol=1e-3)


def test_asked_to_it_rejoins_slowly() -> None:
    streamed = Streamed(after=AfterContact.REJOIN)
    streamed.guided()
    before = streamed.arm.q.copy()
    streamed.run(0.5)
    assert streamed.stream.phase is Phase.JOINING
    assert np.abs(streamed.arm.q - before).max() <= 0.5 * 0.2 * 1.1
    streamed.run(3.0)
    np.testing.assert_allclose(streamed.arm.q, streamed.q, atol=2e-3)


def test_a_silent_stream_stands_and_is_forgotten(streamed: Streamed) -> None:
    for k in range(100):
        streamed.q[0] = 0.1 + 0.2 * np.sin(0.05 * k)
        streamed.run(T)
    moving = abs(streamed.arm.decisions[-1].velocity[0])
    streamed.arm.run(0.15 + moving / LIMITS.acceleration[0] + 2 * T)
    assert np.abs(streamed.arm.decisions[-1].velocity).max() < STANDSTILL_SPEED
    streamed.arm.run_until(Mode.HOLDING, 1.0)
    assert "the stream of a leader fell silent for 0.5 s" in streamed.arm.cause
    assert streamed.arm.controller.stream is None
    assert streamed.arm.controller.next_place().path.name == "sinusoids"


def test_a_stream_that_ends_while_a_hand_leads_is_not_gone_back_to(streamed: Streamed) -> None:
    assert streamed.arm.controller.arm("me") == []
    streamed.run(0.5, **streamed.arm.push(0.4))
    streamed.arm.run(1.0, **streamed.arm.push(0.4))
    assert streamed.arm.mode is Mode.ADMITTANCE
    assert streamed.arm.controller.stream is None
    streamed.arm.run_until(Mode.HOLDING, 4.0)


def test_paused_it_waits_and_start_goes_on(streamed: Streamed) -> None:
    assert streamed.arm.request(Event.PAUSE) == []
    streamed.run(1.0)
    assert streamed.arm.mode is Mode.HOLDING
    assert streamed.arm.controller.stream is streamed.stream
    assert streamed.arm.request(Event.START) == []
    streamed.run(0.5)
    assert streamed.arm.mode is Mode.TRACKING
    assert streamed.arm.request(Event.STOP) == []
    assert streamed.arm.controller.stream is None


targets = st.tuples(
    st.integers(-2, 4),
    st.floats(-0.1, 0.3),
    st.lists(st.floats(-1e9, 1e9) | st.floats(-1.2, 1.2), min_size=2, max_size=2),
    st.integers(0, 5),
    st.booleans(),
)


@settings(max_examples=40)
@given(st.lists(targets, max_size=40))
def test_no_stream_brings_a_setpoint_beyond_a_limit(
    sent: list[tuple[int, float, list[float], int, bool]],
) -> None:
    streamed = Streamed(after=AfterContact.REJOIN)
    arm, number, sent_s = streamed.arm, streamed.number, streamed.number * T
    assert arm.controller.arm("me") == []
    for count, elapsed_s, q, ticks, touched in sent:
        number, sent_s = number + count, sent_s + elapsed_s
        streamed.stream.put(Target(number, sent_s, np.array(q)))
        for _ in range(ticks):
            before = arm.decisions[-1].velocity
            velocity = arm.step(**(arm.push(0.4) if touched else {})).velocity
            assert (np.abs(velocity) <= LIMITS.velocity).all()
            if not touched:
                change = np.abs(velocity - before)
                assert (change <= LIMITS.acceleration * T + 1e-9).all()
            assert ((arm.q >= LIMITS.lower) & (arm.q <= LIMITS.upper)).all()


@pytest.mark.parametrize("far", [0.1, 0.3])
def test_a_waiting_arm_stays_where_a_stream_jumps_from_one_side_of_it_to_the_other(
    streamed: Streamed, far: float
) -> None:
    streamed.guided()
    stands = streamed.arm.q.copy()
    for side in (-far, far):
        streamed.q = stands + side
        for _ in range(20):  # at 20 Hz: targets between them are read
            streamed.run(T)
            streamed.number += 4
            for _ in range(4):
                streamed.arm.step()
    assert streamed.stream.phase is Phase.WAITING
    np.testing.assert_allclose(streamed.arm.q, stands, atol=1e-3)


@pytest.mark.parametrize("held_up_s", [0.05, 0.1, 0.2])
def test_silence_lasts_while_the_daemon_is_held_up(streamed: Streamed, held_up_s: float) -> None:
    """Its ticks are left out; their time has passed."""
    for _ in range(100):
        streamed.q = streamed.q + np.array([0.004, 0.0])
        streamed.run(T)
    arm, moving = streamed.arm, streamed.arm.decisions[-1].velocity[0]
    last_s = arm.time_s
    assert moving > 0.3
    arm.tick += round(held_up_s / T)
    while arm.decisions[-1].velocity[0] > 0.005:
        arm.step()
    braking_s = moving / LIMITS.acceleration[0]
    assert arm.time_s - last_s <= max(0.15, held_up_s) + braking_s + 3 * T
