"""Dynamics of an arm's links, from the URDF with identified bodies in place of its own."""

from daemon.config.schema import Configuration
from estimator.model import Model


def model_of(c: Configuration, urdf: str) -> Model:
    """Model of the links by the URDF's text, with each `body` of the configuration in place of the
    URDF's. Of an arm that is loaded, `Robot.model` is the one. Raises ModelError."""
    return Model(urdf, c.joint_names, c.bodies)
