"""Whatever people do while the arm goes to poses: every setpoint within its limits, no reference
that jumps, and who is touched on the way is yielded to or stopped for at once."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from common.arrays import Vector
from daemon.modes.contact_reactions import AfterQuiet, ContactReaction, Reactions
from daemon.modes.table import Event, Mode
from daemon.motion.admittance import AllowanceSettings
from daemon.motion.pose_path import PosePath
from tests.ideal_arm import LIMITS, IdealArm, T, holding_arm

FAR = AllowanceSettings(max_duration_s=20.0, max_excursion=3.0)
YIELDS = {Mode.ADMITTANCE, Mode.RETRACTING, Mode.STOPPING}
positions = st.floats(-1.0, 1.0) | st.sampled_from([-1.0, 1.0])
poses = st.tuples(positions, positions).map(np.array)
acts = st.one_of(
    st.tuples(st.just("go"), poses, st.floats(0.1, 2.0)),
    st.tuples(st.just("wait"), st.floats(0.01, 4.0)),
    st.tuples(st.just("push"), st.floats(-1.5, 1.5), st.floats(0.01, 2.0)),
    st.tuples(st.sampled_from([Event.START, Event.PAUSE, Event.STOP, Event.DISARM])),
    st.tuples(st.just("arm")),
)


class Watched:
    """An arm, and what must hold in each of its ticks."""

    def __init__(self, arm: IdealArm) -> None:
        self.arm, self.before, self.mode = arm, np.zeros(2), arm.mode
        self.reference = arm.decisions[-1].reference

    def run(self, seconds: float, push: float = 0.0) -> None:
        """Tick for so long, with a torque on the first joint."""
        for _ in range(max(1, round(seconds / T))):
            self.tick(push)

    def tick(self, push: float) -> None:
        arm, mode = self.arm, self.arm.mode
        armed, on_the_way = arm.armed, mode is Mode.TRACKING
        decision = arm.step(**(arm.push(push) if push else {}))
        velocity = decision.velocity
        assert (np.abs(velocity) <= LIMITS.velocity + 1e-9).all()
        # Where it begins to yield, what leads on into the hand is taken back at once.
        taken_back = (velocity * push <= 1e-12) & (np.abs(velocity) <= np.abs(self.before))
        steady = np.abs(velocity - self.before) <= LIMITS.acceleration * T + 1e-9
        assert (steady | taken_back).all(), (mode, arm.mode, self.before, velocity)
        assert (arm.q >= LIMITS.lower - 1e-9).all()
        assert (arm.q <= LIMITS.upper + 1e-9).all()
        if arm.mode is Mode.TRACKING and mode is Mode.TRACKING:
            way = np.abs(decision.reference - self.reference)
            assert (way <= LIMITS.velocity * T + 1e-9).all()
        if push and on_the_way:
            assert arm.mode in YIELDS if armed else arm.mode is Mode.STOPPING
        self.before, self.reference = velocity, decision.reference


def go(arm: IdealArm, goal: Vector, speed: float) -> list[str]:
    path = PosePath.planned("the way to there", arm.q.copy(), goal, speed, LIMITS, 1.0)
    return arm.controller.request(Event.START, "me", arm.time_s, path)


@given(
    st.sampled_from(AfterQuiet),
    st.sampled_from([ContactReaction.ADMITTANCE, ContactReaction.RETRACT, ContactReaction.HOLD]),
    st.lists(acts, max_size=8),
)
@example(
    AfterQuiet.RETURN,
    ContactReaction.ADMITTANCE,
    [("go", np.array([1.0, -1.0]), 2.0), ("arm",), ("wait", 1.0), ("push", 1.5, 1.0)],
)
@example(
    AfterQuiet.RESUME,
    ContactReaction.ADMITTANCE,
    [
        ("go", np.array([1.0, -1.0]), 0.2), ("arm",), ("wait", 2.0), ("push", 1.0, 1.0),
        (Event.PAUSE,), ("wait", 3.0), (Event.START,),
    ],
)  # fmt: skip
def test_setpoints_stay_within_limits_for_any_script(
    after: AfterQuiet, contact: ContactReaction, script: list[tuple[object, ...]]
) -> None:
    reactions = Reactions(contact=contact)
    arm = holding_arm(bounds=FAR, after_quiet=after, reactions=reactions)
    watched, goal = Watched(arm), arm.q.copy()
    for act in script:
        match act:
            case ("go", there, speed):
                held = arm.mode is Mode.HOLDING
                assert (go(arm, there, speed) == []) is held
                goal = there if held else goal
            case ("wait", seconds):
                watched.run(seconds)
            case ("push", torque, seconds):
                watched.run(seconds, torque)
            case ("arm",):
                arm.controller.arm("me")
            case (Event.START,):
                goes_on(arm)
            case (event,):
                arm.request(event)
        watched.run(T)
    # Left alone, what is under way comes to rest; a way that was not forgotten, at its goal.
    for _ in range(20):
        watched.run(3.0)
        goes_on(arm)
        if arm.mode is Mode.HOLDING:
            break
    assert arm.mode is Mode.HOLDING
    if arm.cause == "the way to there came to its end":
        np.testing.assert_allclose(arm.q, goal, atol=5e-3)


def goes_on(arm: IdealArm) -> None:
    """`start` of a way that was halted, which is never refused while nothing is felt."""
    if arm.mode is Mode.HOLDING and arm.controller.machine.paused:
        assert arm.request(Event.START) == []
