"""LeRobot plug-in: an arm run by contactd as a robot, and a hand-guided arm as a teleoperator.

LeRobot imports this package because of its name's prefix, which registers `--robot.type=contactd`
and `--teleop.type=contactd_leader`. docs/lerobot.md has short examples.
"""

from lerobot_robot_contactd.config_contactd import ContactdConfig, ContactdLeaderConfig
from lerobot_robot_contactd.contactd import Contactd
from lerobot_robot_contactd.leader import ContactdLeader

__all__ = ["Contactd", "ContactdConfig", "ContactdLeader", "ContactdLeaderConfig"]
