"""Settings of the robot and of the leader, as LeRobot's command line takes them."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig


@RobotConfig.register_subclass("contactd")
@dataclass(kw_only=True)
class ContactdConfig(RobotConfig):
    """Arm that follows."""

    socket: str = ""  # control socket; empty: that of the service, or of this user's daemon
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


@TeleoperatorConfig.register_subclass("contactd_leader")
@dataclass(kw_only=True)
class ContactdLeaderConfig(TeleoperatorConfig):
    """Arm that is led by hand."""

    socket: str = ""  # control socket of its daemon, of which only the view socket is used
