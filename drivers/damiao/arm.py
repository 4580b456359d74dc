"""Damiao motors of one arm over their whole life: `drivers.api.BootableDrives`."""

from collections.abc import Callable, Sequence

from drivers.can.traffic import Traffic
from drivers.can.wire import Wire
from drivers.damiao.language import DamiaoLanguage
from drivers.damiao.make import frames
from drivers.damiao.settings import DamiaoDrive
from drivers.damiao.setup import DamiaoSetup
from drivers.motors.arm import LISTEN_S, MotorArm


class DamiaoArm(MotorArm):
    """Motors in the tick, and their set-up before it and between two."""

    def __init__(
        self,
        wire: Wire,
        drives: Sequence[DamiaoDrive],
        period_s: float,
        clock: Callable[[], float],
        bitrate: int,
        listen_s: float = LISTEN_S,
    ) -> None:
        traffic = Traffic(frames(drives, period_s), period_s, bitrate)
        language = DamiaoLanguage(drives)
        super().__init__(wire, drives, language, DamiaoSetup, traffic, period_s, clock, listen_s)
