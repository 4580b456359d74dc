"""Removal of files that an installed environment never uses, about half of its size.

    python package/slim.py /opt/contactd.new

The wheels of Pinocchio contain headers and static libraries, and up to three copies of each shared
library under different names, since a wheel has no links; numpy and scipy contain their tests,
zstandard a second library for PyPy. pip and setuptools are not needed either, as nothing is
installed into the environment of a service later.
"""

import os
import shutil
import sys
from pathlib import Path

# Paths below site-packages; `**` is any depth.
UNUSED = (
    "cmeel.prefix/include",
    "cmeel.prefix/bin",
    "cmeel.prefix/lib/cmake",
    "cmeel.prefix/lib/pkgconfig",
    "**/*.a",
    "scipy/**/tests",
    "numpy/**/tests",
    "zstandard/_cffi.*",
    "pip",
    "pip-*.dist-info",
    "setuptools",
    "setuptools-*.dist-info",
    "pkg_resources",
    "_distutils_hack",
    "distutils-precedence.pth",
)

# Programs to keep; those of other packages would no longer work.
OURS = ("activate", "contactctl", "contactd", "python")


def slim(environment: Path) -> None:
    """Remove unused files from a virtual environment. Raises ValueError if it is none."""
    folders = list(environment.glob("lib/python3*/site-packages"))
    if not (environment / "pyvenv.cfg").is_file() or len(folders) != 1:
        raise ValueError(f"{environment} is not a virtual environment")
    for pattern in UNUSED:
        for path in sorted(folders[0].glob(pattern)):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
    for path in environment.glob("bin/*"):
        if not path.name.startswith(OURS):
            path.unlink()
    for folder in {path.parent for path in folders[0].rglob("*.so*")}:
        _share_copies(folder)


def _share_copies(folder: Path) -> None:
    """Replace identical copies of libraries in one folder by hard links."""
    seen: dict[bytes, Path] = {}
    for path in sorted(folder.glob("*.so*")):
        if path.is_symlink() or not path.is_file():
            continue
        first = seen.setdefault(path.read_bytes(), path)
        if first != path:
            new = path.with_name(f"{path.name}.new")
            os.link(first, new)
            new.replace(path)


if __name__ == "__main__":
    slim(Path(sys.argv[1]))
