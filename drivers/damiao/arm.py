"""Damiao motors of one arm over their whole life: `drivers.api.BootableDrives`."""

from typing import Any, ClassVar

from drivers.damiao import make as module
from drivers.damiao.language import DamiaoLanguage
from drivers.damiao.setup import DamiaoSetup
from drivers.motors.arm import MotorArm


class DamiaoArm(MotorArm):
    """Motors in the tick, and their set-up before it and between two."""

    make: ClassVar[Any] = module
    language, setup = DamiaoLanguage, DamiaoSetup
