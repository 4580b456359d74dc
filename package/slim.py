"""Removal of files that an installed environment never runs: half of its size.

    python package/slim.py /opt/contactd.new

The wheels of Pinocchio bring headers and static libraries for those who compile against it, and
each shared library under up to three names as so many copies, since a wheel has no links; numpy
and scipy bring their tests, zstandard the same library once more for PyPy. pip and setuptools have
done their work by then: nothing is ever installed into a service.
"""

import os
import shutil
import sys
from pathlib import Path

# Below site-packages; `**` is any depth.
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

# Programs that stay; others come with the packages, and what they start is gone.
OURS = ("activate", "contactctl", "contactd", "python")


def slim(environment: Path) -> None:
    """Remove them from a virtual environment. Raises ValueError where there is none."""
    folders = list(environment.glob("lib/python3*/site-packages"))
    if not (environment / "pyvenv.cfg").is_file() or len(folders) != 1:
        raise ValueError(f"{environment} is no virtual environment")
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
    """Give libraries of one folder that are byte by byte the same one place on the disk."""
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
