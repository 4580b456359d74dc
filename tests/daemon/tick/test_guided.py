"""A guide in the whole tick, with a simulated hand: across it the tool is held, along it is led."""

import numpy as np
import pytest

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.study import wrench
from bench.study.guided import across, along
from bench.study.hands import Hands
from bench.study.leading import arm_at_work, robot_of
from common.arrays import Vector
from daemon.assembly import build_motion
from daemon.modes.machine import ModeMachine
from daemon.modes.table import Event, Mode
from daemon.protocol.guide import GuideAxes
from daemon.tick.leading import Leading
from daemon.tick.telemetry import state_of

LINE = GuideAxes(stiff=("y", "z", "rx", "ry", "rz"))


@pytest.fixture(scope="module", params=[("openarm", 3), ("beam", 3)], ids=lambda p: p[0])
def on(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ArmInTheLoop:
    """An armed arm at work, in a pose in which its drives stand 20 N across."""
    arm, seed = request.param
    robot = robot_of(wrench.robot_of(arm, tmp_path_factory.mktemp(arm)))
    on = arm_at_work(robot, seed, 5.0)
    on.request(Event.PAUSE)
    return on


def test_20_newtons_across_give_less_than_2_mm_and_what_is_free_is_led(on: ArmInTheLoop) -> None:
    settled, furthest, _ = across(on, LINE, 1, -1.0)
    assert settled < 2.0
    assert furthest < 20.0
    free, _, _ = across(on, GuideAxes(), 1, -1.0)
    assert free > 20.0
    _, off = along(on, LINE, 0, 1.0)
    assert off < 15.0
    assert along(on, GuideAxes(), 0, -1.0)[1] > 2.0 * off


def test_an_obstacle_on_the_way_of_the_spring_is_released(on: ArmInTheLoop) -> None:
    """It takes the hand's place within a tick, 3 mm on a way of 20 mm, and is felt as a hand."""
    across(on, LINE, 1, -1.0)
    plant, guide = on.harness.plant, on.tick.controller.motion.guidance._guide
    assert guide is not None
    x, J = Hands(on.robot.model, on.robot.urdf).at_tool(plant.q)
    ahead = on.robot.model.axes(plant.q)[:, 1]
    guide.forget()
    guide.begin(plant.q + np.linalg.pinv(J) @ (0.02 * ahead))
    pressed = []

    def obstacle(q: Vector, _: Vector) -> Vector:
        x_now, J = Hands(on.robot.model, on.robot.urdf).at_tool(q)
        pressed.append(max(ahead @ (x_now - x) - 0.003, 0.0) * 20_000.0)
        torque: Vector = J.T @ (-pressed[-1] * ahead)
        return torque

    on.drives.hold = obstacle
    notices = []
    for _ in range(600):
        on.step()
        notices += [n.text for n in on.last.notices if n.text.startswith("guide yields")]
    assert max(pressed) > 10.0
    assert max(pressed) < 60.0
    assert max(pressed[-10:]) < 28.0
    assert notices[0].startswith("guide yields along y: ")


def test_nothing_moves_without_a_hand_whatever_the_guide(on: ArmInTheLoop) -> None:
    """Off its line by a few millimetres, as it is let go of, the arm stays there."""
    across(on, LINE, 1, -1.0)
    guidance = on.tick.controller.motion.guidance
    assert guidance.led
    on.drives.hold = None
    on.run(0.5)
    assert on.mode is Mode.ADMITTANCE
    assert not guidance.led
    while on.mode is not Mode.HOLDING:
        on.step()
    on.run(2.0)
    q = on.harness.plant.theta.copy()
    controller = on.tick.controller
    for axes in (GuideAxes(stiff=("x", "y", "z")), GuideAxes(frame="base", stiff=("z",)), LINE):
        assert not controller.leading.set_guide(axes, "a person")
        on.run(1.0)
    assert np.abs(on.harness.plant.theta - q).max() < 0.003


def test_a_guide_that_is_refused_leaves_the_one_before(on: ArmInTheLoop) -> None:
    controller = on.tick.controller
    assert not controller.leading.set_guide(LINE, "a person")
    assert controller.leading.set_guide(GuideAxes(frame="palm", stiff=("x",)), "a person")
    assert controller.leading.set_guide(GuideAxes(free=("x",)), "a person")
    assert controller.motion.guidance.axes == LINE
    on.step()
    assert state_of(on.last).guide == str(LINE)
    assert not controller.leading.set_guide(GuideAxes(), "a person")
    on.step()
    assert not state_of(on.last).guide


def test_an_arm_whose_links_are_not_checked_takes_no_guide(on: ArmInTheLoop) -> None:
    """Nor does it say that it has one."""
    motion = build_motion(on.robot, links_trusted=False)
    leading = Leading(ModeMachine(), motion, tuple(on.robot.configuration.joint_names))
    (reason,) = leading.set_guide(GuideAxes(frame="palm", stiff=("x",)), "a person")
    assert "links are not checked" in reason
    assert not motion.guidance.axes.guides
    assert not leading.set_guide(GuideAxes(), "a person")


def test_doubt_begins_the_guide_anew(on: ArmInTheLoop) -> None:
    """Its spring does not pull to a place that was doubted."""
    motion, plant = on.tick.controller.motion, on.harness.plant
    motion.guidance.change(LINE)
    guide, push = motion.guidance._guide, np.full(plant.n, 1e-9)
    assert guide is not None
    for sure, off in ((True, True), (False, False)):
        guide.forget()
        guide.begin(plant.q + 0.02)
        motion.guidance.sure = sure
        motion.step(Mode.ADMITTANCE, plant.q, None, push, 0.01)
        assert (np.abs(guide.spring.off).max() > 1e-3) == off
        motion.velocity[:] = 0.0
