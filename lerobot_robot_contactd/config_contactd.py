"""Settings of the robot and of the leader, for LeRobot's command line."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig


@RobotConfig.register_subclass("contactd")
@dataclass(kw_only=True)
class ContactdConfig(RobotConfig):
    """Settings of a follower arm."""

    socket: str = ""  # control socket; empty: that of the service, or of this user's daemon
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


@TeleoperatorConfig.register_subclass("contactd_leader")
@dataclass(kw_only=True)
class ContactdLeaderConfig(TeleoperatorConfig):
    """Settings of a hand-guided leader arm."""

    socket: str = ""  # control socket of its daemon; only the view socket beside it is used
