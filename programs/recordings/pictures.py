"""Error for plots without matplotlib, which the service's own environment lacks.

It is an extra, too large for a robot's computer; HTML pages do not need it.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

from common.errors import LogError


def without_matplotlib(path: Path, instead: str = "") -> LogError:
    """Error for a plot that cannot be drawn to `path`, with what to install, or where to draw it;
    `instead`: alternative without matplotlib, if any."""
    if find_spec("pip"):
        how = f"install it by `{sys.executable} -m pip install matplotlib`"
    else:
        how = (
            f"{sys.prefix} belongs to the service and takes no further packages: draw it with the "
            "`.venv` of a clone of contactd, which has it"
        )
    return LogError(f"{path}: a plot needs matplotlib; {instead}{how}")
