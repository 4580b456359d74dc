"""Refusal of a picture where matplotlib is not installed, as in the service's own environment.

It is an extra, of a size that a robot's PC need not carry: pages (.html) are drawn without it.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

from common.errors import LogError


def without_matplotlib(path: Path, instead: str = "") -> LogError:
    """Error of a picture that cannot be drawn to `path`: what to install, or where to draw it;
    `instead` is what needs no matplotlib, if anything does."""
    if find_spec("pip"):
        how = f"install it by `{sys.executable} -m pip install matplotlib`"
    else:
        how = (
            f"{sys.prefix} is the service's and takes no more packages: draw it with the `.venv` "
            "of a clone of contactd, which has it"
        )
    return LogError(f"{path}: a picture needs matplotlib; {instead}{how}")
