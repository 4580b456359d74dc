"""Settings of joints known only from logs."""

from typing import ClassVar

from drivers.drive import Drive
from drivers.settings import Settings


class LogProfile(Settings, frozen=True, kw_only=True, tag_field="make", tag="log"):
    """No drive: `contactd run` refuses such an arm, as nothing could stop it."""

    master_timeout_ms: ClassVar[int] = 500
    master_timeout_s: ClassVar[float] = 0.5
    silence_s: ClassVar[float] = 0.0
    stops_alone: ClassVar[bool] = False
    timeout_reaction: ClassVar[str] = (
        "no drive: joints known only from logs, refused by `contactd run`"
    )
    files: ClassVar[tuple[str, ...]] = ()
    sends_motor_position: ClassVar[bool] = True
    one_sign: ClassVar[bool] = False


LogDrive = Drive[LogProfile]
