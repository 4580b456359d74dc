"""Learning of friction: what is learned, what is not, and what must not disturb it."""

from typing import Any

import numpy as np
import pytest

from bench.rigs.arm_without_bus import Push, Recording, Scenario, Subject, record
from bench.rigs.lockstep import ROMEO
from bench.study import courses
from bench.study.estimates import Estimates, build, estimates
from daemon.config.load import load_robot
from estimator.estimator import Estimator
from estimator.motor_position import Side
from simulator.description import Mismatch, SimulationSettings
from tests.estimator.one_learning import DT, FOUND, LEVEL, fresh, teach
from tests.plain import built, plain

RIGHT = dict.fromkeys(Mismatch.__struct_fields__, 0.0)
POLE, SHARE = 0.78, 22.0  # of (13) at 25 /s and 10 ms


class Joint:
    """One joint that swings; its friction is `coulomb` and `viscous` times the model's."""

    def __init__(self, learning: Any = None) -> None:
        self.learning = learning or fresh()
        self.k, self.raw = 0, 0.0
        self.beyond = 0  # ticks beyond the level in force

    def rest(self, seconds: float) -> None:
        for _ in range(round(seconds)):
            teach(self.learning, 0.0, moving=False, dt=1.0)

    def swing(
        self,
        seconds: float,
        *,
        coulomb: float = 1.0,
        viscous: float = 1.0,
        transmitted: float = 0.0,
        load: float = 0.0,
        push: float = 0.0,
        noise: float = 0.0,
        touched: bool = True,
        speed: float = 0.5,
        doubt: float = 0.0,
    ) -> float:
        """Corrected residual at the end [Nm]; the model has 1 Nm and 0.6 Nm s/rad.
        `load` is the friction of a transmitted torque [Nm] that swings with the pose."""
        rng = np.random.default_rng(self.k)
        for _ in range(round(seconds / DT)):
            self.k += 1
            theta_dot = speed * np.sin(0.9 * DT * self.k)
            rubs, drags = np.tanh(theta_dot / 0.02) * DT, 0.6 * theta_dot * DT
            loaded = abs(transmitted * np.cos(0.23 * DT * self.k)) * rubs
            e = push * DT - (coulomb - 1.0) * rubs - (viscous - 1.0) * drags - load * loaded
            self.raw = POLE * self.raw + SHARE * (e + noise * DT * rng.normal())
            self.learning.step(0, rubs, drags, loaded, DT, POLE, SHARE)
            corrected = self.raw - self.learning.correction[0]
            level = self.learning.needed.level(0) * (LEVEL + self.learning.unknown[0])
            self.beyond += abs(corrected) > level
            moving = touched and abs(theta_dot) > 0.05
            teach(self.learning, self.raw, friction=doubt, moving=moving)
        return float(corrected)


@pytest.fixture
def joint() -> Joint:
    return Joint()


@pytest.mark.parametrize(("coulomb", "viscous"), [(1.25, 0.8), (0.7, 1.0), (1.0, 1.4)])
def test_an_error_of_the_friction_is_learned(joint: Joint, coulomb: float, viscous: float) -> None:
    assert joint.learning.error(0) == pytest.approx(0.65)
    corrected = joint.swing(60.0, coulomb=coulomb, viscous=viscous, noise=0.05)
    assert abs(corrected) < 0.03
    assert joint.learning.friction(0) == pytest.approx(coulomb, abs=0.06)
    assert joint.learning.error(0) < 0.3


@pytest.mark.parametrize("load", [0.05, 0.15, 0.4])
@pytest.mark.parametrize("coulomb", [1.0, 1.3])
def test_friction_of_load_is_learned_apart(joint: Joint, load: float, coulomb: float) -> None:
    corrected = joint.swing(120.0, coulomb=coulomb, transmitted=8.0, load=load, noise=0.05)
    assert joint.learning.load(0) == pytest.approx(load, abs=0.015)
    assert joint.learning.friction(0) == pytest.approx(coulomb, abs=0.08)
    assert abs(corrected) < 0.05


def test_learned_friction_of_load_raises_what_is_unknown_with_the_load(joint: Joint) -> None:
    joint.swing(120.0, transmitted=8.0, load=0.2, noise=0.05)
    unknown = []
    for transmitted in (0.0, 2.0, 8.0):
        for _ in range(200):
            joint.learning.step(0, DT, 0.3 * DT, transmitted * DT, DT, POLE, SHARE)
        unknown.append(joint.learning.unknown[0])
    per_load = np.diff(unknown) / [2.0, 6.0]
    assert per_load == pytest.approx([0.3 * joint.learning.load(0)] * 2, rel=1e-6)


def test_friction_that_falls_with_load_is_not_learned(joint: Joint) -> None:
    joint.swing(120.0, transmitted=8.0, load=-0.05, noise=0.05)
    assert joint.learning.load(0) == 0.0


def test_friction_of_a_gear_that_warms_up_is_followed(joint: Joint) -> None:
    joint.swing(60.0, coulomb=1.2)
    joint.swing(180.0, coulomb=0.9)
    assert joint.learning.friction(0) == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("push", [0.2, 0.38, -0.38, 0.4, 0.6])
def test_a_constant_push_is_not_learned_as_friction(push: float, noise: float) -> None:
    """Below and beyond half of the level; the correction takes none of the push."""
    joint = Joint()
    joint.swing(60.0, noise=noise)
    for _ in range(6):
        joint.swing(99.0, push=push, noise=noise)
        assert joint.swing(1.0, push=push) == pytest.approx(push, rel=0.05)


@pytest.mark.parametrize("push", [0.2, 0.38])
def test_a_push_that_comes_and_goes_is_hardly_corrected(joint: Joint, push: float) -> None:
    """For five of every twelve seconds, at any phase of the motion."""
    joint.swing(60.0)
    for _ in range(50):
        taken = push - joint.swing(5.0, push=push)
        assert abs(taken) < 0.1 * push
        joint.swing(7.0)


def test_errors_of_friction_are_learned_beside_errors_of_masses(joint: Joint) -> None:
    """Their part of the residual follows the pose, over seconds."""
    for k in range(600):
        joint.swing(0.5, coulomb=1.2, viscous=0.8, push=0.15 * np.sin(0.23 * k))
    assert joint.learning.friction(0) == pytest.approx(1.2, abs=0.05)
    assert 1.0 - joint.learning.shares[0, 1] == pytest.approx(0.8, abs=0.15)


def test_nothing_is_learned_from_a_possible_touch(joint: Joint) -> None:
    joint.swing(60.0)
    shares = np.array(joint.learning.shares)
    joint.swing(20.0, push=0.9)  # beyond the level
    np.testing.assert_allclose(joint.learning.shares[:, 1:], shares[:, 1:], atol=0.005)
    shares = np.array(joint.learning.shares)
    assert joint.learning.shares[0, 0] == pytest.approx(0.9, abs=0.05)
    joint.swing(0.15, push=0.1)
    joint.swing(0.25, coulomb=1.3, push=0.1)  # not for a while after it either
    np.testing.assert_array_equal(joint.learning.shares[:, 1:], shares[:, 1:])
    joint.swing(20.0, coulomb=1.3, push=0.1)
    assert joint.learning.friction(0) > 1.2


def test_less_is_learned_while_friction_near_rest_is_uncertain() -> None:
    """Breaking away shows another friction than steady motion, so it counts less."""
    joints = [Joint(), Joint()]
    for joint, doubt in zip(joints, (0.0, 1.0), strict=True):
        joint.swing(5.0, coulomb=1.3, doubt=doubt)
    sure, unsure = (joint.learning for joint in joints)
    assert 2.0 * sure.coulomb_left[0] < unsure.coulomb_left[0]
    assert sure.friction(0) == pytest.approx(1.3, abs=0.05)


@pytest.mark.parametrize("how", [{"touched": False}, {"speed": 0.04}])
def test_nothing_is_learned_at_rest_or_in_the_gap(joint: Joint, how: dict[str, Any]) -> None:
    joint.swing(20.0, coulomb=1.2, **how)
    assert not np.any(joint.learning.shares)


def test_learned_friction_is_forgotten_in_a_night(joint: Joint) -> None:
    """All is kept for a minute of rest, most for half an hour; nothing for a night, in which a gear
    cools down."""
    joint.swing(600.0, coulomb=1.4, noise=0.05)
    learning = joint.learning
    learned, left, level = learning.friction(0), learning.coulomb_left[0], learning.needed.level(0)
    assert (learned, left) == (pytest.approx(1.4, abs=0.05), pytest.approx(0.1, abs=0.1))
    joint.rest(60.0)
    kept = (learning.friction(0), learning.coulomb_left[0], learning.needed.level(0))
    assert kept == (learned, left, level)
    joint.rest(1800.0)
    assert 1.25 < learning.friction(0) < learned
    assert left < learning.coulomb_left[0] < 0.8
    assert learning.needed.level(0) < 1.5 * level
    joint.rest(34200.0)
    assert learning.friction(0) == pytest.approx(1.0, abs=0.02)
    assert learning.coulomb_left[0] > 0.99
    assert learning.needed.level(0) > 2.0 * level


@pytest.mark.parametrize("hours", [0.5, 8.0])
@pytest.mark.parametrize(("warm", "cold"), [(0.6, 1.0), (0.8, 1.2), (1.0, 1.4)])
def test_a_gear_that_cooled_down_makes_no_false_contact(
    joint: Joint, warm: float, cold: float, hours: float
) -> None:
    joint.swing(600.0, coulomb=warm, noise=0.05)
    assert (joint.beyond, joint.learning.needed.level(0)) == (0, pytest.approx(0.2, abs=0.05))
    joint.rest(3600.0 * hours)
    joint.swing(120.0, coulomb=cold, noise=0.05)
    assert joint.beyond == 0
    assert joint.learning.friction(0) == pytest.approx(cold, abs=0.06)


def test_shares_are_bounded_for_any_friction(joint: Joint) -> None:
    for step in range(1, 40):  # so slowly that it is never beyond half of the level
        joint.swing(60.0, coulomb=1.0 + 0.05 * step)
    assert np.abs(joint.learning.shares)[0, 1:].max() == pytest.approx(1.2)


def test_unknown_friction_shrinks_and_is_none_at_rest(joint: Joint) -> None:
    joint.swing(1.5)
    before = float(joint.learning.unknown[0])
    assert 0.4 < before < 0.9
    joint.swing(np.pi / 0.9 * 40)
    assert float(joint.learning.unknown[0]) < 0.3 * before


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_non_finite_and_huge_input_is_not_learned(joint: Joint, bad: float) -> None:
    joint.swing(30.0, coulomb=1.2)
    joint.learning.step(0, bad, bad, bad, DT, POLE, SHARE)
    assert_relearns(joint)


def assert_relearns(joint: Joint) -> float:
    """Learning recovers after a tick of the last step; returns the error it began with."""
    teach(joint.learning, 0.0)
    joint.learning.reset(0)
    before, joint.raw = joint.learning.error(0), 0.0
    joint.swing(60.0, coulomb=1.2)
    assert joint.learning.friction(0) == pytest.approx(1.2, abs=0.02)
    return before


def test_input_too_large_to_be_solved_is_forgotten(joint: Joint) -> None:
    joint.learning.step(0, 1e200, 1e200, 0.0, DT, POLE, SHARE)
    joint.learning.needed.quiet_s[0] = 1.0
    assert assert_relearns(joint) == pytest.approx(0.65)


@pytest.mark.parametrize("seed", range(3))
def test_the_covariance_stays_positive_definite(seed: int) -> None:
    """Symmetric to the last bit and positive definite, for any input."""
    rng, learning = np.random.default_rng(seed), fresh()
    size = 10.0 ** rng.uniform(-3.0, 2.0)
    for k in range(30_000):
        if k % 500 == 0:
            rubs, drags, load, e = DT * size * rng.normal(size=4)
            level, moving = rng.choice([0.01, 1e9]), rng.random() < 0.8
        learning.step(0, rubs, drags, load, DT, POLE, SHARE)
        teach(learning, SHARE * e, level, moving=moving)
    P = np.array(learning.covariance[0])
    np.testing.assert_array_equal(P, P.T)
    assert (np.linalg.eigvalsh(P) > 0.0).all()
    spread = np.array([0.4 * LEVEL, 0.4, 0.4, 0.1])
    assert (np.diag(P) <= 1.01 * spread**2).all()


def test_unknown_friction_is_half_of_what_was_not_learned() -> None:
    """Half of all friction of either sign before anything was learned."""
    learning = fresh()
    assert learning.unknown_at(0, -1.0, 0.6, 0.0) == pytest.approx(0.8)
    assert learning.unknown_at(0, 0.0, 0.0, -3.0) == 0.0
    Joint(learning).swing(60.0)
    assert learning.unknown_at(0, 1.0, 0.0, 0.0) == pytest.approx(0.5 * learning.coulomb_left[0])
    assert learning.unknown_at(0, 0.0, 1.0, 0.0) == pytest.approx(0.5 * learning.viscous_left[0])
    assert learning.unknown_at(0, 1.0, 1.0, 0.0) < 0.5


def test_compiled_and_plain_are_the_same_to_the_last_bit() -> None:
    ends = []
    for modules in (built("estimator"), plain("estimator")):
        joint = Joint(fresh(modules["learning"].Learning))
        joint.swing(30.0, coulomb=1.3, viscous=0.7, noise=0.1)
        names = ("covariance", "columns", "shares", "coulomb_left", "viscous_left", "unknown")
        state = {name: np.asarray(getattr(joint.learning, name)) for name in names}
        needed = joint.learning.needed
        state |= {name: np.asarray(getattr(needed, name)) for name in (*FOUND, "quiet_s", "loud_s")}
        ends.append([values.tobytes() for values in state.values()] + [needed.level(0)])
        for name in ("shares", "peak", "unknown"):
            assert np.any(state[name]), name
        assert 0.2 < needed.level(0) < 1.0
    assert ends[0] == ends[1]


# --- in the estimator --------------------------------------------------------------------------

SECONDS, PUSHED_S = 150.0, 60.0


@pytest.fixture(scope="module")
def days() -> dict[str, Recording]:
    """The Romeo arm at work with friction 30 % off: free, and with joints 2 and 4 pushed by 0.8
    times the level from PUSHED_S on."""
    robot = load_robot(ROMEO)
    settings = SimulationSettings(seed=5, mismatch=Mismatch(**RIGHT | {"friction": 30.0}))
    course, _ = courses.day(robot.configuration, 2, SECONDS)
    levels = np.array([joint.thresholds.contact for joint in robot.configuration.joints])
    hand = 0.8 * levels * np.isin(range(7), (1, 3))
    push = Push(round(1000 * PUSHED_S), round(1000 * (SECONDS - PUSHED_S)), hand)
    return {
        name: record(
            Subject(robot=robot, settings=settings),
            Scenario(seconds=SECONDS, motion=course, pushes=pushes),
        )
        for name, pushes in (("free", ()), ("pushed", (push,)))
    }


def estimated(recording: Recording, **changes: Any) -> tuple[Estimator, Estimates]:
    estimator = build(load_robot(ROMEO), **changes)
    return estimator, estimates(estimator, recording)


def test_learning_lowers_the_residual_of_motion_and_keeps_that_of_a_push(
    days: dict[str, Recording],
) -> None:
    _, usual = estimated(days["free"], learning=False)
    learned, ours = estimated(days["free"])
    late = days["free"].time_s > PUSHED_S
    moving = late[:, np.newaxis] & (np.abs(days["free"].samples[:, 2]) > 0.1)
    sizes = [
        np.sqrt(np.nanmean(np.where(moving, e.residuals["backlash"], np.nan) ** 2, axis=0))
        for e in (usual, ours)
    ]
    assert (sizes[1] < 0.6 * sizes[0])[:4].all(), sizes
    friction = np.array([learned._kernel.learning.friction(i) for i in range(7)])
    assert (np.abs(np.abs(friction[:4] - 1.0) - 0.3) < 0.12).all(), friction
    _, pushed = estimated(days["pushed"])
    level = 0.8 * np.array([0.5, 0.3])
    last = days["free"].time_s > SECONDS - 30.0
    shown = np.median((pushed.residuals["backlash"] - ours.residuals["backlash"])[last], axis=0)
    np.testing.assert_allclose(shown[[1, 3]], level, rtol=0.1)


def test_levels_sink_to_what_untouched_motion_needs(days: dict[str, Recording]) -> None:
    """And no untouched motion goes beyond them."""
    estimator, found = estimated(days["free"])
    needed, levels = estimator._kernel.learning.needed, estimator.detector.levels
    share = np.array([needed.level(i) for i in range(7)])
    np.testing.assert_array_equal(levels.share, share)
    np.testing.assert_array_equal(levels.crossing, [needed.crossing_level(i) for i in range(7)])
    has_gap = np.array([joint.half_gap > 0.0 for joint in load_robot(ROMEO).configuration.joints])
    assert (np.asarray(needed.crossing_peak) < 1.0)[has_gap].all()
    assert (share >= 0.2).all()
    assert (share[:4] < 0.8).all(), share
    fastest = estimator.levels_at(np.full(7, 0.5))
    fresh = build(load_robot(ROMEO)).levels_at(np.full(7, 0.5))
    assert (fastest[:4] < 0.8 * fresh[:4]).all()
    assert not np.any(np.abs(found.residuals["backlash"]) > found.threshold)


def test_levels_are_raised_while_another_joint_lands(days: dict[str, Recording]) -> None:
    """At least six tenths of the configured level, at once, for joints with a lower one."""
    estimator, found = estimated(days["free"])
    contact = np.array([j.thresholds.contact for j in load_robot(ROMEO).configuration.joints])
    gap = found.side == Side.GAP
    lands = np.any(gap[:-1] & ~gap[1:], axis=1)
    late = days["free"].time_s[1:] > PUSHED_S
    assert np.count_nonzero(lands & late) > 10
    needed = found.threshold[1:] / contact
    assert (needed[lands & late] > 0.6 - 1e-9).all()
    assert needed[~lands & late].min() < 0.4
    assert (np.asarray(estimator.detector.levels.share) < 0.6).any()


def test_with_learning_off_nothing_is_learned(days: dict[str, Recording]) -> None:
    estimator, found = estimated(days["pushed"], learning=False)
    assert "learning" not in estimator.memory()
    assert not np.any(estimator._kernel.learning.shares)
    np.testing.assert_array_equal(estimator.detector.levels.share, 1.0)
    np.testing.assert_array_equal(found.residuals["backlash"][-1], estimator.residuals[0])


@pytest.mark.parametrize("at", [3000, 9000])
def test_a_restored_memory_continues_bit_identically(days: dict[str, Recording], at: int) -> None:
    recording = days["pushed"]
    whole, other = (build(load_robot(ROMEO)) for _ in range(2))
    for row in recording.samples[: at - 200]:
        whole.step(*row)
    other.restore(whole.memory())
    for k, row in enumerate(recording.samples[at - 200 : at + 200]):
        a, b = whole.step(*row), other.step(*row)
        np.testing.assert_array_equal(a.residual, b.residual, str(k))
        np.testing.assert_array_equal(a.threshold, b.threshold, str(k))
    assert whole.memory() == other.memory()


@pytest.mark.parametrize(
    ("rested_s", "carried_s", "share"),
    [*((s, 1e4, [0.5] * 3) for s in (30.0, 59.0)), (61.0, 1e4, [1.0] * 3), (0.1, 0.0, [1, 1, 0.5])],
)
def test_a_joint_starts_at_its_stated_level_after_a_minute_or_where_it_carries_more(
    rested_s: float, carried_s: float, share: list[float]
) -> None:
    """The third joint carries little at zero, the first two more than was ever seen."""
    estimator, zero = build(load_robot(ROMEO)), np.zeros(7)
    memory = estimator.memory()
    memory["learning"]["squares_s"] = [0.0] * 7  # it had needed half of its level
    memory["learning"]["peak"] = [0.5 / 1.6] * 7
    memory["learning"]["carried_s"] = [carried_s] * 7
    estimator.restore(memory)
    for _ in range(round(rested_s / 0.01)):
        estimator.step(zero, zero, zero, zero)
    for _ in range(5):
        estimate = estimator.step(zero, zero, np.full(7, 0.02), zero)
    assert estimate.level_share[:3] == pytest.approx(share, abs=0.06)


@pytest.mark.parametrize(
    ("error", "unknown", "doubted"),
    [(0.0, 0.0, 0.2), (0.02, 0.02, 0.04)],  # not identified, and identified
)
def test_friction_per_load_is_unknown_by_its_identified_error(
    error: float, unknown: float, doubted: float
) -> None:
    """Not identified, it raises levels only where learning is in doubt."""
    learning = fresh(load=0.1, error=error)
    assert learning.unknown_at(0, 0.0, 0.0, 5.0) == pytest.approx(5.0 * unknown)
    learning.step(0, 0.0, 0.0, 5.0 * DT, DT, 0.0, 1.0 / DT)
    assert learning.doubted_at(0, 1.0) == pytest.approx(5.0 * doubted)


@pytest.mark.parametrize(
    ("needed", "coulomb", "w", "counts"),
    [
        *[(1.0, -0.06, 0.3, 1.0), (0.9, -0.06, -0.3, 0.5), (0.7, -0.06, 0.3, 0.0)],
        *[(1.0, 0.02, -0.3, 0.0), (1.0, -0.6, 0.3, 0.757)],  # smaller by it; at most half the level
    ],
)
def test_learned_friction_raises_the_threshold_by_at_most_half_the_level(
    needed: float, coulomb: float, w: float, counts: float
) -> None:
    threshold = []
    for share in (0.0, coulomb):
        estimator, zero = build(load_robot(ROMEO), beside=()), np.zeros(7)
        memory = estimator.memory()
        learned = memory["learning"] | {"squares_s": [0.0] * 7, "carried_s": [1e4] * 7}
        learned["shares"][2][2], learned["peak"][2] = share, needed / 1.6
        estimator.restore(memory | {"learning": learned})
        for tick in range(50):  # a hand drags it along, whatever rubs
            seen = estimator.step(zero, q := zero + 0.01 * tick * w, zero + w, q)
        threshold.append(seen.threshold[2])
    learned = abs(seen.residual - seen.uncorrected)[2]
    assert learned > 0.008
    assert threshold[1] - threshold[0] == pytest.approx(counts * learned, abs=0.003)
