"""The Romeo arm, nominal, for the simulator's tests."""

from pathlib import Path

import pytest

from simulator.description import ArmDescription, JointDescription

FOLDER = Path(__file__).parents[2] / "configs" / "romeo_left_arm"
COLUMNS = {
    "name": [
        "LShoulderPitch",
        "LShoulderYaw",
        "LElbowRoll",
        "LElbowYaw",
        "LWristRoll",
        "LWristYaw",
        "LWristPitch",
    ],
    "node": [1, 2, 3, 4, 5, 6, 7],
    "gear": [150.0, 150.0, 100.0, 100.0, 100.0, 80.0, 80.0],
    "rated_current_A": [2.0, 1.5, 1.2, 1.2, 0.6, 0.3, 0.3],
    "max_current_A": [4.0, 3.0, 2.4, 2.4, 1.2, 0.6, 0.6],
    "torque_constant": [4.77, 3.01, 3.09, 2.51, 1.81, 1.44, 1.0],
    "rotor_inertia": [0.08, 0.06, 0.03, 0.025, 0.008, 0.003, 0.003],
    "half_gap": [0.018, 0.025, 0.003, 0.011, 0.0, 0.0, 0.023],
    "motor_coulomb": [0.9, 0.7, 0.4, 0.35, 0.12, 0.05, 0.04],
    "motor_viscous": [0.6, 0.4, 0.2, 0.15, 0.05, 0.02, 0.02],
    "link_coulomb": [0.09, 0.07, 0.04, 0.035, 0.012, 0.005, 0.004],
    "link_viscous": [0.06, 0.04, 0.02, 0.015, 0.005, 0.002, 0.002],
    "lower": [-1.44478, -0.430472, -2.0944, -1.5708, -3.66519, -0.436332, -0.977384],
    "upper": [2.22041, 1.14032, 2.0944, 0.0, 0.523599, 0.436332, 0.977384],
    "initial_position": [0.0, 0.2, 0.0, -0.5, 0.0, 0.0, 0.0],
}


@pytest.fixture(scope="session")
def romeo() -> ArmDescription:
    rows = [dict(zip(COLUMNS, row, strict=True)) for row in zip(*COLUMNS.values(), strict=True)]
    joints = tuple(JointDescription(**row) for row in rows)  # type: ignore[arg-type]
    return ArmDescription(urdf=FOLDER / "arm.urdf", eds=FOLDER / "drive.eds", joints=joints)
