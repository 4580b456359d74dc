"""Debian package of a tree that `make deb` installed below another root.

    python package/deb.py build/deb dist

It is built by dpkg-deb. `control` combines debian/control with properties of the tree: version,
architecture, size, and the Python version of the environment. The package has no conffiles: it
does not contain the files that users edit (decision 0068).
"""

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

_OURS = Path(__file__).parent / "debian"
_SCRIPTS = ("preinst", "postinst", "prerm", "postrm")


def build(root: Path, out: Path) -> Path:
    """Build the package in `out`. Raises CalledProcessError if a tool fails."""
    about = root / "DEBIAN"
    about.mkdir()
    version = _output(root / "opt/contactd/bin/python", "-P", "-c", _VERSION)
    architecture = _output("dpkg", "--print-architecture")
    (library,) = (root / "opt/contactd/lib").glob("python3.*")
    files = sorted(path for path in root.rglob("*") if path.is_file() and about != path.parent)
    fields = (_OURS / "control").read_text().splitlines(keepends=True)
    fields[1:1] = [f"Version: {version}\n", f"Architecture: {architecture}\n"]
    fields[1:1] = [f"Installed-Size: {_kilobytes(root)}\n"]
    fields = [line.replace("Depends: ", f"Depends: {library.name}, ") for line in fields]
    (about / "control").write_text("".join(fields))
    (about / "md5sums").write_text("".join(_digest(path, root) for path in files))
    for name in _SCRIPTS:
        shutil.copy(_OURS / name, about)
        (about / name).chmod(0o755)
    for path in (root, about, about / "control", about / "md5sums"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    package = out / f"contactd_{version}_{architecture}.deb"
    words = ("dpkg-deb", "--root-owner-group", "-Zxz", "-z2", "--build", root, package)
    subprocess.run(words, check=True)
    return package


_VERSION = "from importlib.metadata import version; print(version('contactd'))"


def _output(*words: str | Path) -> str:
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()


def _kilobytes(root: Path) -> int:
    return int(_output("du", "-sk", "--exclude=DEBIAN", root).split()[0])


def _digest(path: Path, root: Path) -> str:
    return f"{hashlib.md5(path.read_bytes()).hexdigest()}  {path.relative_to(root)}\n"


if __name__ == "__main__":
    made = build(Path(sys.argv[1]), Path(sys.argv[2]))
    print(f"{made}: {made.stat().st_size / 1e6:.1f} MB")
