"""Version of these sources: the release of the last git tag, and the distance from it.

At the tag v0.1.0 it is 0.1.0; twelve commits later it is 0.1.0+12.g1a2b3c4, with the suffix
`.edited` if files differ from the commit. That is newer than 0.1.0 and older than any later
release, for pip and dpkg alike. A clone without tags uses the latest release of CHANGELOG.md
(0.1.0+g1a2b3c4), as do sources without git (0.1.0). hatchling calls this (pyproject.toml), unless
a source archive states the version.

    python version.py
"""

import re
import subprocess
from pathlib import Path

_RELEASED = re.compile(r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d\d-\d\d$", re.MULTILINE)
_TAG = "v[0-9]*.[0-9]*.[0-9]*"


def version(root: Path) -> str:
    """Version of the sources in `root`. Raises ValueError if it cannot be determined."""
    described = _describe(root)
    if described.startswith("v"):
        tag, commits, rest = described.split("-", 2)
        there = commits == "0" and not rest.endswith("-edited")
        return _local(tag.removeprefix("v"), "" if there else f"{commits}-{rest}")
    return _local(released(root), f"g{described}" if described else "")


def released(root: Path) -> str:
    """Latest release in CHANGELOG.md. Raises ValueError if there is none."""
    found = _RELEASED.search((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    if found is None:
        raise ValueError(f"{root}/CHANGELOG.md: no line such as `## [0.1.0] - 2026-11-23`")
    return found[1]


def _local(release: str, behind: str) -> str:
    return f"{release}+{behind.replace('-', '.')}" if behind else release


def _describe(root: Path) -> str:
    """Output of git describe: v0.1.0-12-g1a2b3c4, without a tag 1a2b3c4, without a clone empty."""
    if not (root / ".git").exists():  # otherwise git would describe an enclosing clone
        return ""
    words = ("git", "describe", "--tags", "--long", "--always", "--match", _TAG, "--dirty=-edited")
    try:
        done = subprocess.run(words, cwd=root, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):  # no git, or a clone of another user
        return ""
    return done.stdout.strip()


if __name__ == "__main__":
    print(version(Path(__file__).parent))
