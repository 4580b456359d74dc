"""URDF of the Romeo arm against the public description, where that is installed (`make verify`)."""

from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

OURS = Path(__file__).parents[2] / "configs" / "romeo_left_arm" / "arm.urdf"


def public_urdf() -> Path:
    try:
        shipped = files("example-robot-data") or []
    except PackageNotFoundError:
        pytest.skip("the `verify` extra (example-robot-data, 400 MB) is not installed")
    return next(Path(str(f.locate())) for f in shipped if f.name == "romeo.urdf")


@pytest.mark.verify
def test_mass_matrix_and_gravity_are_those_of_the_public_description():
    ours = pin.buildModelFromUrdf(str(OURS))
    whole = pin.buildModelFromUrdf(str(public_urdf()))
    arm = list(ours.names)[1:]
    others = [whole.getJointId(name) for name in list(whole.names)[1:] if name not in arm]
    public = pin.buildReducedModel(whole, others, pin.neutral(whole))
    assert list(public.names) == list(ours.names)
    np.testing.assert_array_equal(ours.lowerPositionLimit, public.lowerPositionLimit)
    np.testing.assert_array_equal(ours.upperPositionLimit, public.upperPositionLimit)
    a, b = ours.createData(), public.createData()
    pin.seed(1)
    for _ in range(20):
        q = pin.randomConfiguration(ours)
        np.testing.assert_allclose(pin.crba(ours, a, q), pin.crba(public, b, q), atol=1e-12)
        np.testing.assert_allclose(
            pin.computeGeneralizedGravity(ours, a, q),
            pin.computeGeneralizedGravity(public, b, q),
            atol=1e-12,
        )
