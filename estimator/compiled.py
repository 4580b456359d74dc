"""Which of the modules that should be compiled run as plain Python, decision 0037."""

import importlib
from collections.abc import Sequence

MODULES = (
    *("elementary", "dynamics", "link_velocity", "stiction", "motor_position"),
    *("interval", "residual", "contact_detector", "kernel"),
)


def uncompiled(names: Sequence[str] = MODULES) -> list[str]:
    """Modules of the estimator that are run from their source."""
    modules = [importlib.import_module(f"estimator.{name}") for name in names]
    return [m.__name__ for m in modules if str(m.__file__).endswith(".py")]
