"""Which of the modules that should be compiled run as plain Python, decision 0037.

`python -m estimator.compiled` says so, and nothing where all are compiled.
"""

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


def warning() -> str:
    """What to tell the user; empty where all are compiled."""
    plain = uncompiled()
    if not plain:
        return ""
    return (
        f"not compiled, a tick takes far longer: {', '.join(plain)} (install the headers of "
        "Python, on Debian python3-dev, then `make install` again; in a checkout `make test`)"
    )


if __name__ == "__main__" and warning():
    print(f"contactd: {warning()}")
