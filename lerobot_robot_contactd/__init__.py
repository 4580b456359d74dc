"""Plug-in of LeRobot: an arm that contactd runs as a robot, and one that is led as a teleoperator.

LeRobot imports this package by the prefix of its name; that registers `--robot.type=contactd` and
`--teleop.type=contactd_leader`. docs/lerobot.md has both in ten lines.
"""

from lerobot_robot_contactd.config_contactd import ContactdConfig, ContactdLeaderConfig
from lerobot_robot_contactd.contactd import Contactd
from lerobot_robot_contactd.leader import ContactdLeader

__all__ = ["Contactd", "ContactdConfig", "ContactdLeader", "ContactdLeaderConfig"]
