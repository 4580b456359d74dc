"""RobStride motors of one arm over their whole life: `drivers.api.BootableDrives`."""

from collections.abc import Callable, Sequence

from drivers.can.traffic import Traffic
from drivers.can.wire import Wire
from drivers.motors.arm import LISTEN_S, MotorArm
from drivers.robstride.language import RobStrideLanguage
from drivers.robstride.make import frames
from drivers.robstride.settings import RobStrideDrive
from drivers.robstride.setup import RobStrideSetup


class RobStrideArm(MotorArm):
    """Motors in the tick, and their set-up before it and between two."""

    def __init__(
        self,
        wire: Wire,
        drives: Sequence[RobStrideDrive],
        period_s: float,
        clock: Callable[[], float],
        bitrate: int,
        listen_s: float = LISTEN_S,
    ) -> None:
        traffic = Traffic(frames(drives, period_s), period_s, bitrate)
        language = RobStrideLanguage(drives)
        super().__init__(wire, drives, language, RobStrideSetup, traffic, period_s, clock, listen_s)
