"""A hand that pushes, holds, guides and lets go, on a clock that it is given."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO, lockstep_rig
from common.errors import ConfigurationError
from simulator.hand import TAKING_S, VISIT_S, Hand
from simulator.hand_script import Gap, Give, Guide, Hold, Press, Push, Release, read_script

NAMES = ("a", "b")
Q = np.array([0.1, -0.2])
STILL = np.zeros(2)


def hand(*script: Any, damping_limit: float = 10.0) -> Hand:
    made = Hand(script, NAMES, np.full(2, damping_limit))
    made.begin(100.0)
    return made


def torque(one: Hand, q: Any = Q, q_dot: Any = STILL) -> list[float]:
    out = np.zeros(2)
    one.torque(q, q_dot, out)
    return [float(value) for value in out]


@pytest.mark.parametrize(
    ("shape", "expected"),
    [("step", [2.0, 2.0, 2.0]), ("ramp", [0.0, 0.5, 1.5]), ("pulse", [0.0, 2**0.5, 2**0.5])],
)
def test_a_push_has_its_shape_and_ends(shape: Any, expected: list[float]) -> None:
    one = hand(Push(at_s=1.0, joint="b", torque=2.0, duration_s=0.5, shape=shape))
    assert one.update(100.999, Q) == []
    assert not one.touching
    assert one.update(101.0, Q) == ["begin push b 2 Nm"]
    seen = []
    for t in (101.0, 101.125, 101.375):
        one.update(t, Q)
        seen.append(torque(one)[1])
    assert seen == pytest.approx(expected, abs=1e-9)
    assert one.update(101.5, Q) == ["end push b 2 Nm"]
    assert torque(one) == [0.0, 0.0]
    assert one.done


@pytest.mark.parametrize(
    ("lasts", "expected"), [(0.5, [0.0, 10.0, 20.0, 0.0]), (None, [0.0, 10.0, 20.0, 20.0])]
)
def test_a_press_rises_and_its_torque_follows_the_pose(
    lasts: float | None, expected: list[float]
) -> None:
    """It rises, and its torque follows the pose."""
    script = (Press(at_s=1.0, force=(0.0, 20.0, 0.0), rise_s=0.2, duration_s=lasts),)
    one = Hand(script, NAMES, np.full(2, 10.0), at_tool=lambda q, force: q * force[1])
    one.begin(100.0)
    seen = []
    for t in (101.0, 101.1, 101.4, 101.6):
        one.update(t, np.array([1.0, t - 100.0]))
        seen += [torque(one)[0], torque(one)[1] / (t - 100.0)]
    assert seen == pytest.approx(np.repeat(expected, 2))
    one.take(Release(at_s=0.0))
    one.update(102.0, Q)
    assert not one.touching


@pytest.mark.parametrize(("asked", "pressed"), [(None, 0.08), (0.5, 0.5)])
def test_in_a_gap_it_presses_with_a_hundredth_of_what_the_motor_gives_or_as_asked(
    asked: float | None, pressed: float
) -> None:
    one = Hand((), NAMES, np.full(2, 10.0), strongest=np.array([3.0, 8.0]))
    one.take(Gap(at_s=0.0, joint="b", torque=asked))
    one.update(0.0, Q)
    seen = []
    for visit in range(4):
        one.update(TAKING_S + (visit + 0.9) * VISIT_S, Q)
        seen.append(torque(one)[1])
    assert seen == pytest.approx([pressed, -pressed, pressed, -pressed])


@pytest.mark.parametrize(
    ("strongest", "friction", "asked", "pulled"),
    [
        ([3.0, 80.0], None, None, [0.6, 4.0]),
        ([3.0, 80.0], None, 0.5, [0.5, 0.5]),
        ([30.0, 8.0], [0.1, 0.0], None, [0.4, 1.6]),
    ],
    ids=["a fifth of what the motor gives", "as asked", "at most four times the friction"],
)
def test_the_torque_of_a_hand_that_leads_is_limited(
    strongest: list[float], friction: Any, asked: float | None, pulled: list[float]
) -> None:
    """By its friction, too: the contact level of an identified joint is some share of it."""
    limits = {"strongest": np.array(strongest)}
    limits |= {"friction": np.array(friction)} if friction else {}
    one = Hand((), NAMES, np.full(2, 10.0), **limits)
    words = one.take(Guide(at_s=0.0, to={"a": 2.0, "b": 2.0}, speed=1000.0, max_torque=asked))
    if friction:
        assert words == "lead a to 2 rad, b to 2 rad, with at most 0.4 Nm, 1.6 Nm"
    one.update(0.0, Q)
    one.update(1.0, Q)
    assert torque(one) == pytest.approx(pulled)


def test_two_pushes_add_up() -> None:
    one = hand(
        Push(at_s=0.0, joint="a", torque=1.0, duration_s=1.0),
        Push(at_s=0.0, joint="a", torque=-3.0, duration_s=2.0),
    )
    one.update(100.5, Q)
    assert torque(one) == [-2.0, 0.0]


def test_hold_is_a_spring_where_the_joint_was() -> None:
    one = hand(Hold(at_s=0.0, joints=("a",), stiffness=40.0, damping=2.0, max_torque=4.0))
    one.update(100.0, Q)
    assert torque(one) == [0.0, 0.0]
    assert torque(one, Q + 0.05) == pytest.approx([-2.0, 0.0])
    assert torque(one, Q, np.array([0.5, 0.5])) == pytest.approx([-1.0, 0.0])
    assert torque(one, Q + 1.0) == pytest.approx([-4.0, 0.0])


def test_damping_is_softened_to_the_limit() -> None:
    one = hand(Hold(at_s=0.0, joints=("a", "b"), damping=2.0), damping_limit=0.5)
    one.update(100.0, Q)
    assert torque(one, Q, np.array([0.2, 0.2])) == pytest.approx([-0.1, -0.1])


def test_guide_leads_at_its_speed_then_holds_until_release() -> None:
    one = hand(
        Guide(at_s=0.0, to={"a": 0.2}, speed=0.25, stiffness=40.0, damping=0.0), Release(at_s=1.0)
    )
    words: list[str] = []
    for k in range(200):
        words += one.update(100.0 + 0.001 * k, Q)
    # Since the grip at 0.1 the anchor has moved by 0.25 rad/s * 0.2 s.
    assert torque(one)[0] == pytest.approx(40.0 * 0.05, abs=0.02)
    for k in range(200, 999):
        words += one.update(100.0 + 0.001 * k, Q)
    assert torque(one, np.array([0.2, 0.0])) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert words == ["begin lead a to 0.2 rad", "end lead, holding still"]
    assert one.update(101.0, Q) == ["begin release"]
    assert not one.touching
    assert torque(one, Q + 1.0) == [0.0, 0.0]


def test_damper_of_a_guide_moves_along() -> None:
    one = hand(Guide(at_s=0.0, to={"a": 0.9}, speed=0.25, stiffness=1e-9, damping=2.0))
    for k in range(10):
        one.update(100.0 + 0.001 * k, Q)
    assert torque(one, Q, np.array([0.25, 0.0])) == pytest.approx([0.0, 0.0], abs=1e-6)
    assert torque(one)[0] == pytest.approx(0.5)


def test_nothing_happens_before_begin() -> None:
    one = Hand([Hold(at_s=0.0, joints=("a",))], NAMES, np.ones(2))
    assert one.update(1e9, Q) == []


def test_unknown_joint_is_refused() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^hand script: no joint 'elbow'; there are: a, b$"
    ):
        hand(Push(at_s=0.0, joint="elbow", torque=1.0, duration_s=1.0))


def test_a_script_file_is_read_in_order_of_time(tmp_path: Path) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text(
        "- {at_s: 6.0, act: push, joint: a, torque: 2.0, duration_s: 0.5}\n"
        "- {at_s: 2, act: guide, to: {a: 0.4}, speed: 0.25}\n"
        "- {at_s: 9, act: release}\n"
    )
    assert read_script(path) == (
        Guide(at_s=2, to={"a": 0.4}, speed=0.25),
        Push(at_s=6.0, joint="a", torque=2.0, duration_s=0.5),
        Release(at_s=9),
    )


@pytest.mark.parametrize(
    "text",
    [
        "- {act: push}",
        "- {act: kick, at_s: 1}",
        "- {act: release, at_s: -1}",
        "- {act: release, at_s: .inf}",
        "- {act: lean, at_s: 0, joint: a, torque: .nan}",
        "- {act: lean, at_s: 0, joint: a, torque: 1.0e+6}",
        "- {act: push, at_s: 0, joint: a, torque: -.inf, duration_s: 1}",
        "- {act: guide, at_s: 0, to: {a: .nan}, speed: 1}",
        "- {act: guide, at_s: 0, to: {a: 1}, speed: .inf}",
        "- {act: give, at_s: 0, mass: .inf}",
        "- {act: give, at_s: 0, mass: 1, com: [.nan, 0, 0]}",
        "- {act: release, at_s: 1, speed: 1}",
        "act: release",
        "- {act: release, at_s: 1, at_s: 2}",
        "- {act: guide, at_s: 1, speed: 1, to: {a: 1, a: 2}}",
        "[" * 5000,
        "- [",
    ],
)
def test_bad_script_names_the_file(tmp_path: Path, text: str) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=r"hand\.yaml"):
        read_script(path)


@pytest.mark.parametrize(
    ("act", "said"),
    [
        ("{act: kick, at_s: 1}", "act 2, act: invalid value 'kick'; there are push, lean, press, "),
        ("{act: release, at_s: -1}", "act 2, at_s: expected `float` >= 0.0"),
        ("{act: lean, at_s: 1, joint: a}", "act 2: object missing required field `torque`"),
        ("{act: guide, at_s: 1, speed: 1, to: {a: b}}", "act 2, to[...]: expected `float`"),
    ],
)
def test_a_bad_act_is_named_and_what_there_is(tmp_path: Path, act: str, said: str) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text(f"- {{act: release, at_s: 0}}\n- {act}\n")
    with pytest.raises(ConfigurationError, match=re.escape(f"hand script: {said}")):
        read_script(path)


def test_a_script_starts_with_the_first_target_velocity(master: Callable[..., Any]) -> None:
    """The script starts with the first target velocity; a strong guide takes a limp elbow along."""
    script = (
        Guide(at_s=0.5, to={"LElbowRoll": 0.3}, speed=0.5, stiffness=60.0, max_torque=6.0),
        Push(at_s=0.2, joint="LWristPitch", torque=0.3, duration_s=0.1),
    )
    one = master(hand_script=script)
    one.enable()
    for _ in range(100):
        one.tick(0x0F, 0.0)
    assert not one.arm.hand.began
    began = one.arm.now
    for _ in range(20):
        one.tick(0x0F, np.eye(7)[6] * 0.1)
    for _ in range(10):
        one.tick(0x00, 0.0)
        pushed = float(one.arm.tau_ext[6])
        assert pushed in (0.0, 0.3)
    one.arm.advance(one.arm.now + 2.0)
    reports = [(event.kind, event.text) for event in one.events if event.kind == "hand"]
    assert reports[0] == ("hand", "begin push LWristPitch 0.3 Nm")
    assert reports[-1] == ("hand", "end lead, holding still")
    assert one.events[0].at_s == pytest.approx(began + 0.02 + 0.2, abs=0.011)
    assert one.arm.plant.q[2] == pytest.approx(0.3, abs=0.03)
    assert np.abs(one.arm.plant.q_dot).max() < 0.5


def test_a_hand_gives_a_load_and_takes_it_away(tmp_path: Path) -> None:
    script = tmp_path / "cup.yaml"
    script.write_text(
        "- {at_s: 2, act: give, mass: 0}\n- {at_s: 1, act: give, mass: 0.3, com: [0.1, 0, 0]}\n"
    )
    acts = read_script(script)
    assert acts[0] == Give(at_s=1.0, mass=0.3, com=(0.1, 0.0, 0.0))
    given: list[Give] = []
    one = Hand(acts, NAMES, np.ones(2), given.append)
    one.begin(100.0)
    assert one.update(101.0, Q) == ["begin carry 0.3 kg"]
    assert given == [acts[0]]
    assert not one.touching
    assert one.update(102.0, Q) == ["begin carry 0 kg"]
    assert given == list(acts)
    assert one.done


def test_an_arm_carries_what_its_hand_is_given() -> None:
    cup = Give(at_s=0.2, mass=0.3, com=(0.07, 0.0, 0.0))
    with lockstep_rig(ROMEO, hand=(cup,)) as rig:
        mass = rig.arm.plant.parameters.model.inertias[7].mass
        rig.enable()
        rig.run(2.0)
        assert rig.arm.hand.began
        assert rig.arm.plant.parameters.model.inertias[7].mass == pytest.approx(mass + 0.3)


def test_a_load_without_a_place_lies_where_the_daemon_takes_it_to_lie() -> None:
    with lockstep_rig(ROMEO, hand=(Give(at_s=0.0, mass=0.5),)) as rig:
        body = rig.arm.plant.parameters.model.inertias[7]
        bare, held = body.mass, body.lever.copy()
        place = rig.tick.estimator.model.tool_place
        rig.enable()
        rig.run(0.1)
        body = rig.arm.plant.parameters.model.inertias[7]
        load = (body.mass * body.lever - bare * held) / 0.5
        np.testing.assert_allclose(load, place, atol=0.005)
