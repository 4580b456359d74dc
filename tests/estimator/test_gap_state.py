"""Gap state of a joint: in the gap when clear of the border, without a load, and in no doubt."""

from itertools import pairwise

import numpy as np
import pytest

from estimator.motor_position import Side
from estimator.settings import GapSettings
from tests.estimator.one_joint import ALPHA, Joint


def test_gap_only_when_clear_of_the_border_and_without_torque() -> None:
    joint = Joint()
    joint.settle(2.0)  # LEFT, theta = +alpha; the rotor then runs back through the gap
    seen = []
    for _ in range(40):
        joint.step(w=-0.1)
        seen.append((abs(joint.phi) / ALPHA, joint.side))
    assert joint.phi == pytest.approx(ALPHA)
    for phi, side in seen:
        assert (side == Side.GAP) == (phi < 1 - joint.settings.margin), phi
    assert {side for _, side in seen} == {Side.LEFT, Side.GAP, Side.RIGHT}


def test_an_interval_counts_as_gap_only_if_both_its_ends_are() -> None:
    joint = Joint()
    joint.settle(2.0)
    sides, engaged = [joint.side], []
    for _ in range(40):
        engaged.append(joint.step(w=-0.1)[0])
        sides.append(joint.side)
    both = [one == two == Side.GAP for one, two in pairwise(sides)]
    assert engaged == [not apart for apart in both]
    assert 5 < sum(both) < 35


@pytest.mark.parametrize(
    ("torque", "speed", "gap"),
    [
        (0.1, -0.1, True),
        (-0.1, -0.1, True),
        (0.4, -0.2, False),
        (0.9, -0.001, True),  # at rest, friction may hold it
        (1.4, -0.001, False),
    ],
)
def test_a_load_in_the_middle_of_the_gap_is_never_dropped(
    torque: float, speed: float, gap: bool
) -> None:
    joint = Joint()
    joint.settle(2.0)
    for _ in range(20):
        joint.step(w=-0.1)
    assert abs(joint.phi) < 0.1 * ALPHA
    joint.step(w=speed, torque=torque)
    # A load where there can be none: until it has been there for some ticks, it is unknown.
    assert joint.side == (Side.GAP if gap else Side.UNKNOWN)


def test_clear_of_the_border_by_more_than_what_phi_may_be_off() -> None:
    joint = Joint(GapSettings(compliance=0.001))
    joint.settle(8.0)
    said = []
    for _ in range(40):
        joint.step(w=-0.1)
        said.append((abs(joint.phi), joint.side == Side.GAP))
    assert {gap for _, gap in said} == {False, True}
    for phi, gap in said:
        assert gap == (phi < ALPHA - 1.3 * joint.sigma - 1e-4), phi


def test_the_faster_it_turns_the_clearer_of_the_border_it_must_be() -> None:
    """By a millisecond of its way, which its link's sample may be older."""
    speed, reported = 0.8, 0
    for k in range(60):
        joint = Joint()
        joint.settle(2.0)
        joint.step(w=-k * speed / 60)
        for _ in range(5):
            joint.step(w=-speed)
            from_border = ALPHA - abs(joint.phi) - 1.3 * joint.sigma
            if abs(from_border - 0.001 * speed) > joint.settings.hysteresis:
                assert (joint.side == Side.GAP) == (from_border > 0.001 * speed), joint.phi
            reported += bool(0.0 < from_border < 0.001 * speed)
    assert reported > 3


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_phi_that_rests_near_a_border_is_at_it(sign: float) -> None:
    """In the middle it may rest: a hand, or friction, holds the link there. At 4 mrad/s it does not
    rest."""
    for uncertainties, way, gap in ((2.0, 0.0, False), (2.0, 0.004, True), (3.0, 0.0, True)):
        joint = Joint()
        joint.settle(2.0)
        phi = sign * (ALPHA - uncertainties * joint.sigma)
        joint.set(phi=phi)
        for _ in range(25):
            joint.step()
        assert joint.side == Side.GAP
        for k in range(25):
            joint.set(phi=phi - sign * way * 0.01 * k)
            joint.step()
        assert (joint.side == Side.GAP) is gap, (uncertainties, way)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_phi_that_drifts_rests_all_the_same(sign: float) -> None:
    """An integrated theta drifts by a velocity's bias while friction hides the gear's load."""
    joint = Joint()
    joint.settle(2.0)
    phi = sign * (ALPHA - 2.0 * joint.sigma)
    said = []
    for k in range(300):
        joint.set(phi=phi - sign * 0.001 * 0.01 * k)
        joint.step(torque=-sign * 0.4)
        said.append(joint.side)
    # Clear by 2 to 4 sigma: in the gap only once it has drifted clear of where it would rest.
    assert joint.sigma == pytest.approx(0.0014)
    assert said[:29] == [Side.GAP] * 29
    where = Side.RIGHT if sign > 0.0 else Side.LEFT
    assert said[35:80] == [where] * 45
    changes = [k for k, (before, after) in enumerate(pairwise(said)) if before != after]
    assert len(changes) <= 2, changes


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_load_that_bends_the_gear_as_far_as_the_gap_is_wide_shows_the_side(sign: float) -> None:
    joint = Joint(GapSettings(compliance=0.001))
    joint.settle(sign * 30.0)
    assert joint.sigma == ALPHA
    assert joint.side == (Side.LEFT if sign > 0.0 else Side.RIGHT)
    joint.step(torque=-sign * 30.0)  # unknown until it has been there for some ticks
    assert joint.side == Side.UNKNOWN


def test_no_gap_once_theta_is_as_uncertain_as_the_gap_is_wide() -> None:
    joint = Joint(GapSettings(velocity_bias=0.01))
    joint.settle(2.0)
    for _ in range(20):
        joint.step(w=-0.1)
    assert joint.side == Side.GAP
    growth = []
    for k in range(300):
        joint.step(w=0.003 if k % 2 else -0.003)
        growth.append(joint.sigma)
    assert joint.side == Side.UNKNOWN
    assert joint.sigma == ALPHA
    assert np.all(np.diff(growth) >= 0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("noise", [0.00003, 0.00005])
def test_at_the_border_an_encoders_noise_changes_nothing(sign: float, noise: float) -> None:
    # Link and rotor stand, phi anywhere near where "gap" begins; the encoder's last bits do not.
    rng = np.random.default_rng(1)
    begins = ALPHA * (1.0 - GapSettings().margin)
    changes, said = [], set()
    for near in np.linspace(begins - 0.0002, begins + 0.0002, 17):
        joint = Joint()
        joint.settle(2.0)
        joint.set(phi=sign * near)
        sides = []
        for shaken in rng.uniform(-noise, noise, 300):
            joint.step(q=shaken)
            sides.append(joint.side)
        changes.append(sum(before != after for before, after in pairwise(sides)))
        said |= set(sides)
    # Once into the gap, and once more when phi has rested there.
    assert max(changes) <= 2
    assert said == {Side.GAP, Side.RIGHT if sign > 0.0 else Side.LEFT}


def test_it_is_in_the_gap_up_to_the_margin_and_comes_in_further_inside() -> None:
    # Both ways across the border: out at the margin, in again only beyond the hysteresis.
    joint = Joint(GapSettings(compliance=0.0, hysteresis=0.001))
    joint.settle(2.0)
    joint.set(phi=0.0)
    joint.step()
    assert joint.side == Side.GAP
    begins = ALPHA * (1.0 - joint.settings.margin)
    for phi, side in (
        (begins - 0.0001, Side.GAP),
        (begins + 0.0001, Side.RIGHT),
        (begins - 0.0009, Side.RIGHT),
        (begins - 0.0011, Side.GAP),
    ):
        joint.set(phi=phi)
        joint.step()
        assert joint.side == side


@pytest.mark.parametrize("torque", [1.4, -1.4, 0.0])
def test_in_doubt_it_counts_as_engaged_and_says_unknown(torque: float) -> None:
    # Nothing is known of phi but that it is somewhere; its mean is the middle of the gap. A load
    # that changes its sign explains nothing and shows no side.
    joint = Joint()
    for k in range(200):
        engaged = joint.step(torque=torque * (-1) ** k)
        assert abs(joint.phi) < 0.1 * ALPHA
        assert joint.side == Side.UNKNOWN
        assert not joint.position.gap[0]
        assert engaged[0]
