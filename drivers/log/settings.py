"""Settings of joints that are known from logs alone."""

from typing import ClassVar

from drivers.drive import Drive
from drivers.settings import Settings


class LogProfile(Settings, frozen=True, kw_only=True, tag_field="make", tag="log"):
    """No drive: `contactd run` refuses an arm of these, as nothing could stop it."""

    master_timeout_ms: ClassVar[int] = 500
    patience_s: ClassVar[float] = 0.5
    silence_s: ClassVar[float] = 0.0
    stops_alone: ClassVar[bool] = False
    without_us: ClassVar[str] = "no drive: joints of logs alone, which `contactd run` refuses"
    files: ClassVar[tuple[str, ...]] = ()
    sends_motor_position: ClassVar[bool] = True
    one_sign: ClassVar[bool] = False


LogDrive = Drive[LogProfile]
