"""Hand-guided arm of contactd as a LeRobot Teleoperator."""

from typing import Any

from lerobot.teleoperators import Teleoperator
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from lerobot_robot_contactd.config_contactd import ContactdLeaderConfig
from lerobot_robot_contactd.latest import LatestState, OfContactd


class ContactdLeader(OfContactd, Teleoperator):
    """Leader whose actions are the link positions of an arm, `NAME.pos` [rad]."""

    config_class = ContactdLeaderConfig
    name = "contactd_leader"

    def __init__(self, config: ContactdLeaderConfig) -> None:
        super().__init__(config)
        self.config = config
        self._latest: LatestState | None = None

    @property
    def feedback_features(self) -> dict[str, type]:
        """Empty: the leader accepts no feedback."""
        return {}

    def connect(self, calibrate: bool = True) -> None:
        """Connect to the daemon's view socket."""
        del calibrate
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        self._latest = LatestState(self.config.socket)

    def get_action(self) -> dict[str, Any]:
        """Positions of its links. Raises ConnectionError if the daemon is gone or silent."""
        if self._latest is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        position = self._latest.get()["link_position"]
        return {f"{joint}.pos": q for joint, q in zip(self.joints, position, strict=True)}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing: the leader accepts no feedback."""

    def disconnect(self) -> None:
        """Close the connection."""
        if self._latest is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        self._latest.close()
        self._latest = None
