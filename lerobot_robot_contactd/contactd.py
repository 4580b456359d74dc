"""Arm run by contactd as a LeRobot Robot: it follows actions as a stream of targets, and yields to
contact meanwhile."""

from functools import cached_property
from typing import Any, Final

from lerobot.cameras import make_cameras_from_configs
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from contactd_client import Client, ControlError, Stream
from lerobot_robot_contactd.config_contactd import ContactdConfig
from lerobot_robot_contactd.latest import LatestState, OfContactd, control_socket

MODES: Final = (
    "off", "enabling", "holding", "tracking", "admittance", "retracting", "returning", "releasing",
    "stopping", "faulted",
)  # fmt: skip
"""Modes by their value in an observation; -1: unknown."""
SILENCE: Final = "fell silent"
"""Text in the daemon's refusal after a stream that merely paused."""
FOLLOWS: Final = frozenset({"joining", "following", "stalled"})
"""Phases in which the arm is held back by neither a contact nor an operator."""


class Contactd(OfContactd, Robot):
    """LeRobot Robot of an arm run by contactd.

    Observation: for each joint `NAME.pos` [rad], `NAME.vel` [rad/s], external torque `NAME.torque`
    and contact level `NAME.level` [Nm]; `contact` (1.0 during a contact), `mode` (index in MODES),
    and the cameras. Action: `NAME.pos` [rad].
    """

    config_class = ContactdConfig
    name = "contactd"

    def __init__(self, config: ContactdConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras = make_cameras_from_configs(config.cameras)
        self._latest: LatestState | None = None
        self._client: Client | None = None
        self._stream: Stream | None = None

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        """Names and types of an observation."""
        kinds = ("pos", "vel", "torque", "level")
        floats = [f"{joint}.{kind}" for kind in kinds for joint in self.joints]
        images = {name: (c.height, c.width, 3) for name, c in self.config.cameras.items()}
        return {**dict.fromkeys([*floats, "contact", "mode"], float), **images}

    def connect(self, calibrate: bool = True) -> None:
        """Connect to the daemon. The arm does not move before the first action."""
        del calibrate
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        self._latest = LatestState(self.config.socket)
        self._client = Client(control_socket(self.config.socket))
        for camera in self.cameras.values():
            camera.connect()

    def get_observation(self) -> dict[str, Any]:
        """Latest observation. Raises ConnectionError if the daemon is gone or silent."""
        if self._latest is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        state = self._latest.get()
        columns = {
            "pos": state["link_position"],
            "vel": state["link_velocity"],
            "torque": state["residual"],
            "level": state["threshold"],
        }
        observation: dict[str, Any] = {
            f"{joint}.{kind}": value
            for kind, values in columns.items()
            for joint, value in zip(self.joints, values, strict=True)
        }
        observation["contact"] = float(any(state["thresholded"]))
        mode = state["mode"]
        observation["mode"] = float(MODES.index(mode) if mode in MODES else -1)
        for name, camera in self.cameras.items():
            observation[name] = camera.async_read()
        return observation

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Send the next target, and return it; the arm starts to follow with the first. Raises
        ControlError, with the reason, if the arm does not follow, or no longer does. After a mere
        pause, as while LeRobot saves an episode, following restarts slowly, unless the arm waits
        after a contact."""
        if self._client is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        q = [float(action[f"{joint}.pos"]) for joint in self.joints]
        state = self._stream.state if self._stream else None
        try:
            self._follow().to(q)
        except ControlError as error:
            follows = state is not None and state["phase"] in FOLLOWS
            if not follows or SILENCE not in str(error):
                raise
            self._client.close()
            self._client, self._stream = Client(control_socket(self.config.socket)), None
            self._follow().to(q)
        return {f"{joint}.pos": value for joint, value in zip(self.joints, q, strict=True)}

    def _follow(self) -> Stream:
        assert self._client is not None
        if self._stream is None:
            self._stream = self._client.follow()
        return self._stream

    def disconnect(self) -> None:
        """Halt the arm, and close all connections."""
        if self._latest is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        try:
            if self._stream is not None:
                self._stream.end()
        finally:
            self._stream = None
            if self._client is not None:
                self._client.close()
            self._latest.close()
            self._client = self._latest = None
            for camera in self.cameras.values():
                camera.disconnect()
