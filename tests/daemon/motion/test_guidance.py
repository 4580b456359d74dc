"""Guidance: the axes that are asked for, a spring for a sure hand alone, anew after a doubt."""

import numpy as np
import pytest

from bench.rigs.lockstep import OPENARM
from common.arrays import Vector
from common.errors import ModelError
from daemon.config.load import load_robot
from daemon.config.vectors import limits_of
from daemon.motion.guidance import Guidance
from daemon.protocol.guide import GuideAxes

ROBOT = load_robot(OPENARM)
MODEL, LIMITS = ROBOT.model, limits_of(ROBOT.configuration)
GAIN = np.array([joint.admittance_gain for joint in ROBOT.configuration.joints])
Q = LIMITS.lower + 0.65 * (LIMITS.upper - LIMITS.lower)
STILL, ROOM = np.zeros(MODEL.n), np.ones((2, MODEL.n))
PUSH = GAIN * np.random.default_rng(4).normal(size=MODEL.n) * 0.1


def guided(axes: GuideAxes) -> Guidance:
    guidance = Guidance(MODEL, np.full(MODEL.n, 0.5), 8.0)
    guidance.change(axes)
    return guidance


def step(guidance: Guidance, q: Vector, asked: Vector, *, pushed: bool = True) -> Vector:
    push = STILL + 1e-12 * pushed
    return guidance.step(q, STILL, STILL, STILL, asked, STILL + 1.0, GAIN, ROOM, push, 0.01)


@pytest.mark.parametrize("frame", ["tool", "base"])
def test_axes_are_those_of_the_frame_that_is_named(frame: str) -> None:
    out = step(guided(GuideAxes(frame=frame, held=("z",))), Q, PUSH)
    way = MODEL.tool_jacobian(Q) @ out
    along = {"tool": MODEL.axes(Q)[:, 2], "base": np.eye(3)[2]}
    assert {name: abs(axis @ way) < 1e-4 for name, axis in along.items()} == {
        name: name == frame for name in along
    }


def test_redundant_joints_stand_only_where_that_is_asked_for() -> None:
    given, free, held = (
        step(guided(GuideAxes(held=("z",), **how)), Q, PUSH)
        for how in ({}, {"redundant": "free"}, {"redundant": "held"})
    )
    np.testing.assert_array_equal(given, free)
    assert np.linalg.norm(held / np.sqrt(GAIN)) < 0.99 * np.linalg.norm(free / np.sqrt(GAIN))


@pytest.mark.parametrize(
    ("sure", "pushed", "springs"),
    [(True, True, True), (True, False, False), (False, True, False)],
)
def test_the_spring_is_for_a_hand_that_is_sure(sure: bool, pushed: bool, springs: bool) -> None:
    guidance = guided(GuideAxes(stiff=("x", "y", "z")))
    guidance.begin(Q)
    off = Q + 0.02
    guidance.sure = sure
    assert step(guidance, off, STILL, pushed=pushed).any() == springs
    guidance.sure = True
    assert step(guidance, off, STILL).any() == sure  # after a doubt it begins where it is


def test_without_a_witnessed_hand_no_joint_moves_further_than_without_a_guide() -> None:
    """Nor the other way: the velocity with which an arm begins to yield is no hand's."""
    guidance, rng = guided(GuideAxes(stiff=("y", "z", "rx", "ry", "rz"))), np.random.default_rng(5)
    guidance.led = False
    for _ in range(50):
        before, push = rng.normal(size=(2, MODEL.n)) * rng.integers(0, 2, (2, MODEL.n)) * 0.2
        free = before + 0.2 * (push - before)
        share, hand = STILL + 0.2, push / GAIN
        out = guidance.step(Q, STILL, before, before, push, share, GAIN, ROOM, hand, 0.01)
        assert (abs(np.clip(out, np.minimum(free, 0.0), np.maximum(free, 0.0)) - out) < 1e-12).all()


def test_words_of_a_guide_and_of_none() -> None:
    guidance = guided(GuideAxes(stiff=("z",)))
    assert guidance.words == "free x y rx ry rz, stiff z; frame tool"
    guidance.change(GuideAxes())
    assert (guidance.words, guidance.guides) == ("", False)
    with pytest.raises(ModelError, match="not checked"):
        Guidance(None, STILL, 8.0).change(GuideAxes(stiff=("z",)))
