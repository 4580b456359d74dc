"""Automated checklist of a release, to pass before its tag is created.

    make release RELEASE=0.1.0

Quick points come first, and all of them are reported; then checks and tests, the packages built
from a fresh clone with the tag, and the wheel's demo in an environment of its own. It tags and
pushes nothing: at the end it lists the remaining manual steps.
"""

import re
import shutil
import subprocess
import sys
import tomllib
import venv
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "release"
LEFT = """
remaining steps:
  tests/system with the package, and an upgrade to it, on a spare machine (CONTRIBUTING.md, Tests)
  git tag -a v{0} -m "contactd {0}" && git push origin v{0}
  publish {1}/dist/*
"""


def output(*words: str | Path, cwd: Path = ROOT) -> str:
    """Output of a command. Raises CalledProcessError."""
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=True).stdout.strip()


def done(*words: str | Path, cwd: Path = ROOT) -> str:
    """Failure of a command, whose output is shown, as text; empty on success."""
    status = subprocess.run(words, cwd=cwd, check=False).returncode
    return f"`{' '.join(map(str, words))}` ended with {status}" if status else ""


def a_version(release: str) -> str:
    return "" if re.fullmatch(r"\d+\.\d+\.\d+", release) else "not a version such as 0.2.0"


def all_is_committed(release: str) -> str:
    return output("git", "status", "--porcelain")


def the_tag_is_free(release: str) -> str:
    return output("git", "tag", "--list", f"v{release}") and f"v{release} exists"


def the_changelog_is_cut(release: str, root: Path = ROOT) -> str:
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    _, *parts = re.split(r"^## ", text, flags=re.MULTILINE)
    first, second = ([*parts, "", ""])[:2]
    if first.strip() != "[Unreleased]":
        return "## [Unreleased] must be the first section, and empty"
    if not re.match(rf"\[{re.escape(release)}\] - \d{{4}}-\d\d-\d\d\n", second):
        return f"its second section must be: ## [{release}] - YYYY-MM-DD"
    return ""


def the_client_has_its_number(release: str, root: Path = ROOT) -> str:
    project = tomllib.loads((root / "contactd_client/pyproject.toml").read_text())["project"]
    return "" if project["version"] == release else f"contactd_client is {project['version']}"


def checks_and_tests(release: str) -> str:
    return done("make", "check", "test-all")


def packages_of_a_clone_with_the_tag(release: str) -> str:
    shutil.rmtree(OUT, ignore_errors=True)
    output("git", "clone", "--quiet", ROOT, OUT)
    output("git", "tag", f"v{release}", cwd=OUT)
    if wrong := done("make", "dist", "deb", cwd=OUT):
        return wrong
    made = {path.name for path in (OUT / "dist").iterdir()}
    strange = [
        name for name in made if not re.match(rf"contactd[-_]{re.escape(release)}[-._]", name)
    ]
    return f"not of this version: {', '.join(strange)}" if strange or len(made) != 3 else ""


def the_wheels_demo_away_from_here(release: str) -> str:
    place = OUT / "build" / "away"
    venv.create(place, with_pip=True, clear=True)
    (wheel,) = (OUT / "dist").glob("*.whl")
    pip = (place / "bin/pip", "install", "--quiet", "--disable-pip-version-check")
    return done(*pip, f"{wheel}[web]", cwd=place) or done(
        place / "bin/contactd", "demo", "--json", cwd=place
    )


QUICK = (
    a_version, all_is_committed, the_tag_is_free, the_changelog_is_cut, the_client_has_its_number,
)  # fmt: skip
LONG = (checks_and_tests, packages_of_a_clone_with_the_tag, the_wheels_demo_away_from_here)


def passes(point: Callable[[str], str], release: str) -> bool:
    """True if a check passes; the result is printed."""
    wrong = point(release)
    print(f"{'NO' if wrong else 'ok':3} {point.__name__.replace('_', ' ')}", flush=True)
    if wrong:
        print(f"    {wrong}")
    return not wrong


def main(release: str) -> int:
    """Run all checks; returns the exit status, 0 if all pass."""
    held = [passes(point, release) for point in QUICK]
    if not all(held):
        return 1
    if not all(passes(point, release) for point in LONG):
        return 1
    print(LEFT.format(release, OUT), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1] if len(sys.argv) > 1 else ""))
