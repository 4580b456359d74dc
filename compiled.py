"""Which of the modules that should be compiled run as plain Python, decision 0037."""

import importlib
from collections.abc import Sequence

DAEMON = ("daemon.faults.measures", "daemon.motion.bounding", "drivers.counts")
ESTIMATOR = ("elementary", "estimator.dynamics", "estimator.gap", "estimator.kernel")
SIMULATOR = (
    *("elementary", "simulator.links", "simulator.two_masses"),
    *("simulator.servo", "simulator.sensors", "simulator.servo_periods"),
)


def uncompiled(names: Sequence[str]) -> list[str]:
    """Those of the modules that are run from their source."""
    modules = [importlib.import_module(name) for name in names]
    return [m.__name__ for m in modules if str(m.__file__).endswith(".py")]
