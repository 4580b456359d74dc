"""Counts of the drives against limits of the joints, swept around the boundary."""

import msgspec
import pytest

from bench.rigs.lockstep import ROMEO
from daemon.config.counts import COARSEST, unrepresentable
from daemon.config.load import load_robot
from daemon.config.schema import Joint
from drivers.canopen.settings import CanopenProfile

ROBOT = load_robot(ROMEO).configuration
PROFILE = ROBOT.drives["two_encoder_drive"]
JOINT = ROBOT.joints[2]


def joint(lower: float = -1.0, upper: float = 1.0, velocity: float = 1.0, sign: int = 1) -> Joint:
    limits = msgspec.structs.replace(JOINT.limits, lower=lower, upper=upper, velocity=velocity)
    wiring = msgspec.structs.replace(JOINT.wiring, gear=10.0, link_sign=sign, motor_sign=sign)
    return msgspec.structs.replace(JOINT, limits=limits, wiring=wiring)


def profile(entry: str, **changes: object) -> CanopenProfile:
    found = msgspec.structs.replace(getattr(PROFILE, entry), **changes)
    return msgspec.structs.replace(PROFILE, **{entry: found})


def entries(joint: Joint, profile: CanopenProfile, margin: float = 1.0) -> list[str]:
    return [its.at[0] for its, _ in unrepresentable(joint, profile, margin)]


def test_the_shipped_arm_fits() -> None:
    for each in ROBOT.joints:
        assert entries(each, PROFILE, ROBOT.supervisor.speed_margin) == []


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("lower", "upper", "fits"), [(-1.27, 1.27, True), (-1.0, 1.29, False), (-1.29, 1.0, False)]
)
def test_positions(lower: float, upper: float, fits: bool, sign: int) -> None:
    eight_bits = profile("link_position", type="INTEGER8", scale=0.01)
    found = entries(joint(lower, upper, sign=sign), eight_bits)
    assert found == ([] if fits else ["link_position"])


def test_positions_of_an_encoder_without_sign() -> None:
    turn = profile("link_position", type="UNSIGNED16", scale=1e-4, offset=-3.2768)
    assert entries(joint(-3.2, 3.2), turn) == []
    assert entries(joint(-3.2, 3.3), turn) == ["link_position"]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("entry", ["motor_velocity", "target_velocity"])
@pytest.mark.parametrize(("velocity", "fits"), [(1.27, True), (1.29, False)])
def test_velocities_of_the_motor(entry: str, velocity: float, fits: bool, sign: int) -> None:
    eight_bits = profile(entry, type="INTEGER8", scale=0.1)
    assert entries(joint(velocity=velocity, sign=sign), eight_bits) == ([] if fits else [entry])


@pytest.mark.parametrize("entry", ["motor_velocity", "target_velocity"])
@pytest.mark.parametrize(("velocity", "fits"), [(0.63, True), (0.64, False)])
def test_too_fast_must_be_seen(entry: str, velocity: float, fits: bool) -> None:
    eight_bits = profile(entry, type="INTEGER8", scale=0.1)
    found = list(unrepresentable(joint(velocity=velocity), eight_bits, 2.0))
    assert [its.at[0] for its, _ in found] == ([] if fits else [entry])
    for _, reason in found:
        assert reason == (
            "INTEGER8 counts reach from -1.28 to 1.27 rad/s at the link; 2 "
            "(supervisor.speed_margin) times limits.velocity is 1.28"
        )


def test_a_velocity_that_has_no_negative_counts() -> None:
    assert entries(joint(), profile("motor_velocity", type="UNSIGNED32")) == ["motor_velocity"]


@pytest.mark.parametrize(("share", "fits"), [(0.99, True), (1.01, False)])
def test_a_setpoint_may_be_coarse_up_to_a_share_of_the_limit(share: float, fits: bool) -> None:
    coarse = profile("target_velocity", scale=share * COARSEST * 0.8 * 10.0)
    assert entries(joint(velocity=0.8), coarse) == ([] if fits else ["target_velocity"])
