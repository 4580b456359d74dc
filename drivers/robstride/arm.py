"""RobStride motors of one arm over their whole life: `drivers.api.BootableDrives`."""

from typing import Any, ClassVar

from drivers.motors.arm import MotorArm
from drivers.robstride import make as module
from drivers.robstride.language import RobStrideLanguage
from drivers.robstride.setup import RobStrideSetup


class RobStrideArm(MotorArm):
    """Motors in the tick, and their set-up before it and between two."""

    make: ClassVar[Any] = module
    language, setup = RobStrideLanguage, RobStrideSetup
