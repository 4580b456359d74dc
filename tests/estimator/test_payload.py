"""Payload: the model counts it from one tick to the next, and the residuals go on."""

import json

import numpy as np
import pinocchio as pin
import pytest

from common.errors import ModelError
from estimator.model import Model
from estimator.payload import Payload
from tests.estimator.plain import built, plain
from tests.estimator.test_dynamics import ours, random_tree, theirs

RNG = np.random.default_rng(18)
CUP = Payload.of(0.4, (0.07, 0.02, -0.03))
AT = 600
K, T = 25.0, 0.01


@pytest.mark.parametrize(
    ("mass", "com", "words"),
    [
        (0.0, (0.0, 0.0, 0.0), "a payload of 0 kg: must be above 0, up to 100 kg"),
        (-1.0, (0.0, 0.0, 0.0), "-1 kg"),
        (float("nan"), (0.0, 0.0, 0.0), "nan kg"),
        (101.0, (0.0, 0.0, 0.0), "up to 100 kg"),
        (1.0, (0.0, 2.1, 0.0), "centre of the payload (0 2.1 0) m: must be"),
        (1.0, (0.0, float("nan"), 0.0), "centre of the payload"),
        (1.0, (0.0, 0.0), "three numbers"),
    ],
)
def test_an_impossible_payload_is_refused(mass: float, com: tuple[float, ...], words: str) -> None:
    with pytest.raises(ModelError) as refused:
        Payload.of(mass, com)
    assert words in str(refused.value)


@pytest.mark.parametrize("module", ["built", "plain"])
def test_a_carried_mass_is_part_of_the_last_body(module: str) -> None:
    model = random_tree()
    dynamics = ours(model, {"built": built, "plain": plain}[module]()["dynamics"])
    bare = ours(model)
    last, place = model.nv - 1, RNG.uniform(-0.3, 0.3, 3)
    dynamics.carry(last, 9.0, 1.0, 2.0, 3.0)
    dynamics.carry(last, 0.7, *place)  # in place of that
    loaded = model.copy()
    loaded.inertias[last + 1] += pin.Inertia(0.7, place, np.zeros((3, 3)))
    for _ in range(20):
        q, q_dot = RNG.uniform(-3, 3, (2, model.nv))
        dynamics.at(q, q_dot)
        for found, expected in zip(
            (dynamics.momentum, dynamics.beta), theirs(loaded, q, q_dot), strict=True
        ):
            scale = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(np.asarray(found) / scale, expected / scale, atol=2e-14)
    dynamics.carry(last, 0.0, 0.0, 0.0, 0.0)
    for each in (dynamics, bare):
        each.at(q, q_dot)
    assert np.asarray(dynamics.beta).tobytes() == np.asarray(bare.beta).tobytes()
    assert np.asarray(dynamics.momentum).tobytes() == np.asarray(bare.momentum).tobytes()


def test_torques_of_a_payload_are_the_difference_of_gravity(romeo: Model, romeo_urdf) -> None:
    loaded = pin.buildModelFromUrdf(str(romeo_urdf))
    loaded.inertias[7] += pin.Inertia(CUP.mass, np.array(CUP.com), np.zeros((3, 3)))
    data = loaded.createData()
    assert romeo.hand == "l_wrist"
    np.testing.assert_allclose(romeo.tool_place, [0.06987, -0.00381, -0.00165])
    for _ in range(20):
        q = RNG.uniform(-2, 2, 7)
        by_mass, by_place = romeo.payload_torques(q, romeo.down)
        more = pin.computeGeneralizedGravity(loaded, data, q) - romeo.gravity(q)
        np.testing.assert_allclose(-CUP.mass * (by_mass + by_place @ CUP.com), more, atol=1e-13)


def test_the_hand_of_another_order_and_of_a_fixed_tool(romeo: Model, romeo_urdf) -> None:
    names = romeo.names[::-1]
    q = RNG.uniform(-1, 1, 7)
    ours, back = romeo.payload_torques(q, romeo.down), Model(romeo_urdf, names)
    for one, other in zip(ours, back.payload_torques(q[::-1].copy(), romeo.down), strict=True):
        np.testing.assert_allclose(one, other[::-1], atol=1e-14)
    tool = """<joint name="flange" type="fixed"><parent link="l_wrist"/><child link="tool0"/>
      <origin xyz="0.1 0 0.02" rpy="0 0 1.5707963"/></joint><link name="tool0"/></robot>"""
    fixed = Model(romeo_urdf.read_text().replace("</robot>", tool), romeo.names)
    assert fixed.hand == "tool0"
    np.testing.assert_allclose(fixed.tool_place, 0.0, atol=1e-15)
    np.testing.assert_allclose(fixed.in_joint(np.array([0.03, 0.0, 0.0])), [0.1, 0.03, 0.02],
                               atol=1e-8)  # fmt: skip
    by_mass, by_place = fixed.payload_torques(q, romeo.down)
    expected = ours[0] + ours[1] @ [0.1, 0.03, 0.02]
    np.testing.assert_allclose(by_mass + by_place @ [0.03, 0.0, 0.0], expected, atol=1e-7)


@pytest.mark.parametrize("at", [150, 385, AT])
def test_no_residual_jumps_when_the_model_changes(make_estimator, sine_motion, at: int) -> None:
    """r goes from that of the old model to that of the new one as it follows any torque: what is
    left of the difference fades by the pole of (13), from the first tick on."""
    reported, unreported, always = make_estimator(), make_estimator(), make_estimator()
    always.carry(CUP)
    for each in (reported, unreported, always):
        sine_motion.replay(each, slice(0, at))
    reported.carry(CUP)
    rest = slice(at, at + 60)
    rows = [
        np.array([estimate.residual for estimate in sine_motion.replay(each, rest)])
        for each in (reported, unreported, always)
    ]
    pole = (2.0 - T * K) / (2.0 + T * K)
    left = rows[0] - rows[2]
    np.testing.assert_allclose(left[1:], pole * left[:-1], atol=1e-12)
    # In the first tick the new model has acted for one period: no more than K T of the difference.
    whole = rows[1][0] - rows[2][0]
    assert np.abs(whole).max() > 1.0
    np.testing.assert_allclose(left[0], pole * whole, atol=0.01)


def test_reporting_the_same_payload_again_changes_no_bit(make_estimator, sine_motion) -> None:
    one, other = make_estimator(learning=True), make_estimator(learning=True)
    for each in (one, other):
        each.carry(CUP)
        sine_motion.replay(each, slice(0, 400))
    one.carry(Payload.of(0.4, (0.07, 0.02, -0.03)))
    assert one.memory() == other.memory()
    sine_motion.replay(one, slice(400, 500))
    sine_motion.replay(other, slice(400, 500))
    assert one.memory() == other.memory()


@pytest.mark.parametrize("learning", [False, True])
def test_memory_restores_a_payload_bit_by_bit(make_estimator, sine_motion, learning: bool) -> None:
    original, copy = make_estimator(learning=learning), make_estimator(learning=learning)
    assert "carried" not in original.memory()  # recordings made without one stay as they are
    sine_motion.replay(original, slice(0, 300))
    original.carry(CUP)
    original.freeze_learning(True)
    sine_motion.replay(original, slice(300, 400))
    copy.carry(Payload.of(0.1, (0.0, 0.0, 0.0)))
    copy.restore(json.loads(json.dumps(original.memory())))
    assert original.memory() == copy.memory()
    for each in (original, copy):
        sine_motion.replay(each, slice(400, 500))
        each.carry(None)
        each.freeze_learning(False)
        sine_motion.replay(each, slice(500, 600))
    assert original.memory() == copy.memory()
    assert "carried" not in original.memory()
    # A memory without one takes off what is carried now.
    bare = make_estimator(learning=learning)
    copy.carry(CUP)
    copy.restore(original.memory())
    bare.restore(original.memory())
    for each in (bare, copy):
        sine_motion.replay(each, slice(600, 700))
    assert bare.memory() == copy.memory()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda m: m["carried"].pop("payload"), "memory of carried"),
        (lambda m: m["carried"]["payload"].pop(), "kernel.payload: shape"),
        (lambda m: m["carried"]["payload"].__setitem__(0, float("nan")), "kernel.payload"),
        (lambda m: m["carried"].__setitem__("frozen", 2), "kernel.frozen: not within 0"),
    ],
)
def test_a_damaged_memory_is_refused_and_changes_nothing(
    make_estimator, damage, message: str
) -> None:
    estimator = make_estimator()
    estimator.carry(CUP)
    before = estimator.memory()
    memory = estimator.memory()
    damage(memory)
    with pytest.raises(ModelError, match=message):
        estimator.restore(memory)
    assert estimator.memory() == before


def test_nothing_is_learned_while_it_is_frozen(make_estimator, sine_motion) -> None:
    estimator = make_estimator(learning=True)
    sine_motion.replay(estimator, slice(0, 500))
    estimator.freeze_learning(True)
    before = estimator.memory()["learning"]
    estimate = sine_motion.replay(estimator, slice(500, 900))[-1]
    assert estimate.level_share.tolist() == [1.0] * estimator.model.n, "the stated levels"
    after = estimator.memory()["learning"]
    assert after["squares_s"] == before["squares_s"]
    assert max(after["still_s"]) < 1.0, "a joint that moves does not count as one that stands"
    friction = [np.array(learning["shares"])[:, 1:] for learning in (before, after)]
    np.testing.assert_array_equal(*friction)
    estimator.freeze_learning(False)
    sine_motion.replay(estimator, slice(900, 1000))
    learned = np.array(estimator.memory()["learning"]["shares"])[:, 1:]
    assert (learned != friction[0]).any()


def test_learned_friction_is_known_while_learning_is_frozen(make_estimator, sine_motion) -> None:
    """Levels are the stated ones, not those of an arm that was just switched on."""
    taught, fresh = make_estimator(learning=True), make_estimator(learning=True)
    sine_motion.replay(taught, slice(0, 2400))
    taught.freeze_learning(True)
    levels = [sine_motion.replay(each, slice(2400, 2500))[-1].threshold for each in (taught, fresh)]
    assert levels[0].sum() < 0.9 * levels[1].sum()


def test_a_payload_with_a_box_is_printed_with_its_size() -> None:
    assert str(Payload.of(0.2, [0.0, 0.0, 0.1], box=[0.1, 0.1, 0.2])) == (
        "0.2 kg, 0.1 x 0.1 x 0.2 m, at (0.000 0.000 0.100) m"
    )
