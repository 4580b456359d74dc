"""Rigid-body model of an arm: its URDF, with identified bodies replacing those of the URDF."""

from daemon.config.schema import Configuration
from estimator.model import Model


def model_of(c: Configuration, urdf: str) -> Model:
    """Model of the links from the URDF's text, in which each `body` of the configuration replaces
    that of the URDF. A loaded arm has it as `Robot.model`. Raises ModelError."""
    return Model(urdf, c.joint_names, c.bodies)
