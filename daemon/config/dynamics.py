"""Dynamics of an arm's links: the one place where its model is built, from the URDF and the
identified bodies in their place."""

from daemon.config.schema import Configuration
from estimator.model import Model


def model_of(c: Configuration, urdf: str) -> Model:
    """Model of the links by the URDF's text, but of what the configuration has as `body` by that.
    Raises ModelError."""
    bodies = {joint.name: joint.body for joint in c.joints if joint.body is not None}
    return Model(urdf, c.joint_names, bodies)
