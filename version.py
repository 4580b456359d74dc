"""Version of these sources: the release of git's last tag, and the distance from it.

At the tag v0.1.0 it is 0.1.0. Twelve commits behind it 0.1.0+12.g1a2b3c4, with `.edited` at its
end where files differ from the commit: newer than 0.1.0 and older than any next release, for pip
and dpkg alike. A clone without tags takes the latest release of CHANGELOG.md in the tag's place
(0.1.0+g1a2b3c4), sources without git are that release. hatchling asks it (pyproject.toml), unless
a source archive states it already.

    python version.py
"""

import re
import subprocess
from pathlib import Path

_RELEASED = re.compile(r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d\d-\d\d$", re.MULTILINE)
_TAG = "v[0-9]*.[0-9]*.[0-9]*"


def version(root: Path) -> str:
    """Version of the sources in `root`. Raises ValueError where it cannot be determined."""
    described = _describe(root)
    if described.startswith("v"):
        tag, commits, rest = described.split("-", 2)
        there = commits == "0" and not rest.endswith("-edited")
        return _local(tag.removeprefix("v"), "" if there else f"{commits}-{rest}")
    return _local(released(root), f"g{described}" if described else "")


def released(root: Path) -> str:
    """Latest release that CHANGELOG.md names. Raises ValueError where it names none."""
    found = _RELEASED.search((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    if found is None:
        raise ValueError(f"{root}/CHANGELOG.md: no line such as `## [0.1.0] - 2026-11-23`")
    return found[1]


def _local(release: str, behind: str) -> str:
    return f"{release}+{behind.replace('-', '.')}" if behind else release


def _describe(root: Path) -> str:
    """v0.1.0-12-g1a2b3c4, without a tag 1a2b3c4; nothing where `root` is no clone's own folder."""
    if not (root / ".git").exists():  # else git would describe a clone around it
        return ""
    words = ("git", "describe", "--tags", "--long", "--always", "--match", _TAG, "--dirty=-edited")
    try:
        done = subprocess.run(words, cwd=root, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):  # no git here, or another's clone
        return ""
    return done.stdout.strip()


if __name__ == "__main__":
    print(version(Path(__file__).parent))
