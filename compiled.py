"""Modules that should be compiled and run as plain Python, decision 0037.

`python -m compiled` says so of the daemon's, and nothing where all are compiled.
"""

import sys
from pathlib import Path

PACKAGES = ("elementary", "daemon", "drivers", "estimator", "simulator")


def uncompiled() -> list[str]:
    """Modules in use that have types for the compiler, a .pxd, and are run from their source."""
    ours = [(n, m.__file__) for n, m in sys.modules.items() if n.partition(".")[0] in PACKAGES]
    files = [(name, Path(file)) for name, file in ours if file and file.endswith(".py")]
    return sorted(name for name, file in files if file.with_suffix(".pxd").exists())


def warning() -> str:
    """What to tell the user of modules in use; empty where all are compiled."""
    plain = uncompiled()
    if not plain:
        return ""
    return (
        f"not compiled, a tick takes far longer: {', '.join(plain)} (install the headers of "
        "Python, on Debian python3-dev, then `make install` again; in a checkout `make test`)"
    )


if __name__ == "__main__":
    import daemon.assembly  # noqa: F401 - brings in what a tick runs

    if text := warning():
        print(f"contactd: {text}")
