"""Torque constants that `contactd new --log-only` guessed from the URDF's masses.

Friction is as inaccurate as these guesses, and masses identified with them would only reproduce the
URDF's.
"""

from typing import Final

import numpy as np

from common.arrays import Vector
from common.errors import ConfigurationError
from common.yaml_source import parse_yaml
from daemon.config.load import Robot
from drivers.log.settings import LogProfile
from identification.possible_bodies import USUAL

MARK: Final = "# CHECK"
"""Mark of a guess in a line of a draft, to be removed once the value is checked."""

OTHERS: Final = "as other joints"
"""Reason given for a constant that no mass determines."""


def guessed_constants(robot: Robot) -> Vector:
    """Relative errors (n,) of guessed torque constants: infinite for one taken from other joints, 0
    for one that was looked up."""
    c, lines = robot.configuration, robot.text.splitlines()
    shares = np.zeros(len(c.joints))
    for i, joint in enumerate(c.joints):
        line = lines[_line(robot, i) - 1]
        if MARK in line and isinstance(c.drives[joint.wiring.profile], LogProfile):
            shares[i] = np.inf if OTHERS in line else USUAL
    return shares


def refuse_guessed_constants(robot: Robot) -> None:
    """Raise ConfigurationError for the first torque constant that is a guess."""
    for i in np.flatnonzero(guessed_constants(robot)).tolist():
        name = robot.configuration.joints[i].name
        raise ConfigurationError(
            f"{robot.path}:{_line(robot, i)}: joints[{i}] ({name}).torque_constant: guessed from "
            f"the URDF's masses, so it cannot identify masses; look it up in the motor's data "
            f"sheet, times the gear, and remove `{MARK[2:]}` from its line"
        )


def _line(robot: Robot, i: int) -> int:
    return parse_yaml(robot.text, robot.path).line(["joints", i, "torque_constant"])
