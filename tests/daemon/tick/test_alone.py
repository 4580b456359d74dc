"""An armed arm whose learned friction is no longer true: it stands, reports it, and goes on."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.rigs.arm_without_bus import Subject
from bench.rigs.lockstep import ROMEO
from bench.study import alone, world
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration, Joint, Sinusoid
from daemon.modes.contact_reactions import AfterQuiet, ContactReaction
from daemon.modes.table import GUIDED, YIELDING, Event, Mode
from programs.simulate.simulated_robot import read_simulation

ELBOW = 2
START = np.array([0.3, 0.3, 0.0, -0.8, -1.0, 0.0, 0.0])
SWING = Sinusoid(amplitude=0.3, frequency_Hz=0.2)
MOVES = 0.02  # [rad/s]
MOST_S = 0.3
"""of motion with no person at work"""


def robot_with(
    joint: Callable[[Joint], Joint] = lambda j: j,
    swings: tuple[int, Sinusoid] = (ELBOW, SWING),
    **changes: Any,
) -> Robot:
    """The Romeo arm that swings a joint, with another elbow."""
    robot = load_robot(ROMEO)
    c = robot.configuration
    joints = [joint(j) if i == ELBOW else j for i, j in enumerate(c.joints)]
    which, swing = swings
    trajectory = msgspec.structs.replace(c.trajectory, sinusoids={c.joint_names[which]: swing})
    admittance = msgspec.structs.replace(c.admittance, after_quiet=AfterQuiet.RETURN)
    changed: Configuration = msgspec.structs.replace(
        c, joints=joints, trajectory=trajectory, admittance=admittance, **changes
    )
    return replace(robot, configuration=changed)


def gain(value: float) -> Callable[[Joint], Joint]:
    return lambda joint: msgspec.structs.replace(joint, admittance_gain=value)


class Watched:
    """An armed arm at work, whose learned friction a test sets."""

    def __init__(self, robot: Robot, **learned: float) -> None:
        subject = Subject(robot=robot, settings=read_simulation(robot).settings)
        self.on = ArmInTheLoop(subject, robot, START)
        self.on.start()
        self.on.run(4.0)
        assert self.on.permit() == []
        self.modes: list[Mode] = [self.on.mode]
        self.alone_s = self.longest_s = 0.0
        self.notices: list[str] = []
        self._learn(**learned)

    def _learn(self, *, coulomb: float = 0.0, share: float = 0.25) -> None:
        """Set the learned Coulomb friction of the elbow, as certain, and the share of its level
        that is needed."""
        memory = self.on.tick.estimator.memory()
        learned = memory["learning"]
        learned["shares"][ELBOW][2] = coulomb
        learned["covariance"][ELBOW] = (1e-4 * np.eye(4)).tolist()
        learned["coulomb_left"][ELBOW] = 0.1
        learned["moved_s"][ELBOW] = 300.0
        learned["squares_s"][ELBOW] = 300.0 * (share / 2.9) ** 2
        learned["carried_s"][ELBOW] = 300.0 * 9.0  # in motion that carried 3 Nm
        learned["peak"][ELBOW] = 0.0
        self.on.tick.estimator.restore(memory)

    def run(self, seconds: float, pulls: Callable[[float, float], float] | None = None) -> None:
        """Work on; pulls: torque on the elbow [Nm] at a position and a velocity."""
        on, plant = self.on, self.on.harness.plant
        for _ in range(round(seconds / on.period_s)):
            q, velocity = float(plant.q[ELBOW]), float(plant.q_dot[ELBOW])
            on.drives.external[ELBOW] = pulls(q, velocity) if pulls else 0.0
            on.step()
            moves = on.mode in YIELDING and float(np.abs(plant.q_dot).max()) > MOVES
            self.alone_s = self.alone_s + on.period_s if moves else 0.0
            self.longest_s = max(self.longest_s, self.alone_s)
            self.modes.append(on.mode)
            assert on.tick.last is not None
            self.notices += [notice.text for notice in on.tick.last.notices]

    @property
    def contacts(self) -> int:
        """Times that the arm began to yield."""
        pairs = zip(self.modes, self.modes[1:], strict=False)
        return sum(now in YIELDING and before not in GUIDED for before, now in pairs)

    def assert_interrupted_once_at_most(self) -> None:
        assert self.longest_s <= MOST_S
        assert self.contacts <= 1
        assert self.modes[-1] is Mode.TRACKING


@pytest.mark.parametrize("value", [0.5, 5.0])
@pytest.mark.parametrize("coulomb", [-0.7, 0.7])
def test_learned_friction_that_is_gone_moves_nothing(value: float, coulomb: float) -> None:
    """A cover that braked it was learned as friction, and taken away."""
    watched = Watched(robot_with(gain(value)), coulomb=coulomb, share=0.3)
    watched.run(10.0)
    watched.assert_interrupted_once_at_most()
    assert abs(watched.on.tick.estimator.learned().coulomb[ELBOW] - 1.0) < 0.3
    if coulomb < 0.0:
        assert any("LElbowRoll: the learned friction is discarded" in text
                   for text in watched.notices)  # fmt: skip


@pytest.mark.parametrize("factor", [0.5, 1.5, 2.0])
def test_friction_that_changed_costs_one_contact(factor: float) -> None:
    watched = Watched(robot_with(gain(2.0)))
    factors = np.ones(7)
    factors[ELBOW] = factor
    watched.on.harness.plant.scale_friction(factors)
    watched.run(12.0)
    watched.assert_interrupted_once_at_most()


def cable(q: float, velocity: float) -> float:
    """0.3 Nm at the end of the swing."""
    del velocity
    return -0.3 * float(np.clip((q - 0.1) / 0.1, 0.0, 1.0))


def test_a_cable_below_the_stated_level_interrupts_once_and_is_named() -> None:
    watched = Watched(robot_with(gain(2.0)))
    watched.run(25.0, cable)
    assert watched.longest_s <= MOST_S
    assert watched.contacts <= 1
    named = [text for text in watched.notices if "contact at the same place 3 times" in text]
    assert len(named) == 1
    assert named[0].startswith("LElbowRoll: ")


def test_friction_beyond_all_levels_interrupts_no_more_than_five_times() -> None:
    """A shoulder breaks away with twice its friction: no level is for it, and the arm holds."""
    yaw = 1
    robot = robot_with(swings=(yaw, Sinusoid(amplitude=0.35, frequency_Hz=0.15)))
    arm = replace(world.subject(robot, world.LAWS[1], 4), drift=0.0)
    on = ArmInTheLoop(arm, robot, START)
    on.start()
    on.run(4.0)
    assert on.permit() == []
    on.run(90.0)
    plant, factors = on.harness.plant, np.ones(7)
    usual = plant.coulomb.sum(axis=0) / on.tick.estimator.transmission.engaged_coulomb
    factors[yaw] = 2.0 / usual[yaw]
    plant.scale_friction(factors)
    interrupted, before = 0, on.mode
    for _ in range(4000):
        on.step()
        interrupted += on.mode is Mode.ADMITTANCE and before is not Mode.ADMITTANCE
        before = on.mode
    assert 3 <= interrupted <= 6
    assert on.mode is Mode.HOLDING
    assert "interrupted at the same place 5 times" in on.tick.controller.machine.cause


def test_once_the_cable_is_gone_the_level_sinks_again() -> None:
    watched = Watched(robot_with())
    watched.run(12.0, cable)
    assert watched.on.estimate.level_share[ELBOW] > 0.5 or watched.contacts == 1
    watched.run(18.0)
    assert watched.on.estimate.level_share[ELBOW] < 1.2 * 0.25


def test_a_contact_that_only_learning_makes_backs_away_from_nothing() -> None:
    reactions = msgspec.structs.replace(
        load_robot(ROMEO).configuration.reactions, contact=ContactReaction.RETRACT
    )
    watched = Watched(robot_with(reactions=reactions), coulomb=-0.7, share=0.3)
    watched.run(10.0)
    assert Mode.RETRACTING not in watched.modes


def test_a_hand_leads_it_all_the_same() -> None:
    watched = Watched(robot_with(gain(0.5)))
    begin = float(watched.on.harness.plant.q[ELBOW])
    watched.run(3.0, lambda q, velocity: 1.4)
    assert watched.on.mode is Mode.ADMITTANCE
    assert watched.on.harness.plant.q[ELBOW] - begin > 0.4


def stated(joint: Joint) -> Joint:
    levels = msgspec.structs.replace(joint.thresholds, least=None)
    known = {**joint.known, "thresholds": "by hand"}
    return msgspec.structs.replace(joint, thresholds=levels, known=known)


def test_a_level_that_a_person_stated_does_not_sink() -> None:
    watched = Watched(robot_with(stated))
    watched.run(2.0)
    assert watched.on.estimate.level_share[ELBOW] == 1.0
    assert watched.on.estimate.threshold[ELBOW] >= 0.4


def test_work_goes_on_in_a_light_lean() -> None:
    """0.6 of the stated level, all the time: one contact, and the stated level while it lasts."""
    watched = Watched(robot_with(gain(5.0)))
    watched.run(25.0, lambda q, velocity: 0.24)
    assert watched.contacts <= 1
    assert math.isclose(watched.on.estimate.level_share[ELBOW], 1.0)
    assert watched.modes[-1] is Mode.TRACKING
    watched.on.tick.controller.request(Event.PAUSE, "the test", watched.on.time_s)


def test_a_release_moves_no_joint_by_learned_friction_that_is_gone() -> None:
    """A rub at the shoulder is over; a short bump lets go at the elbow, and at nothing else."""
    seed, shoulder = 3, 0
    robot, law, _ = alone.arm_of(seed)
    subject = replace(world.subject(robot, law, seed), drift=0.0)
    on = ArmInTheLoop(subject, robot, alone.START)
    plant, level = on.harness.plant, robot.configuration.joints[shoulder].thresholds.contact
    on.start()
    on.run(60.0)
    for _ in range(round(150.0 / on.period_s)):
        on.drives.external[shoulder] = -0.9 * level * np.tanh(plant.q_dot[shoulder] / MOVES)
        on.step()
    on.drives.external[shoulder] = 0.0
    on.run(0.1)
    assert on.tick.estimator.learned().coulomb[shoulder] > 1.2
    on.drives.external[ELBOW] = -8.0 * np.sign(plant.q_dot[ELBOW])
    on.run(0.15)
    assert on.mode is Mode.RELEASING
    on.drives.external[ELBOW] = 0.0
    begin = float(plant.theta[shoulder])
    on.run(2.0)
    assert on.tick.controller.machine.cause.startswith("let go of contact at LElbowRoll (")
    assert abs(float(plant.theta[shoulder]) - begin) < 0.02
