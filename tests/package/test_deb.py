"""Debian package of an installed tree, as dpkg reads it."""

import shutil
import subprocess
from pathlib import Path

import pytest

from package import deb

SCRIPTS = ("preinst", "postinst", "prerm", "postrm")

pytestmark = pytest.mark.skipif(not shutil.which("dpkg-deb"), reason="needs dpkg-deb")


def said(*words: str | Path) -> str:
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """Package of a tree with next to nothing for an environment."""
    root, out = tmp_path / "root", tmp_path / "out"
    python = root / "opt/contactd/bin/python"
    (root / "opt/contactd/lib/python3.11").mkdir(parents=True)
    python.parent.mkdir()
    python.write_text("#!/bin/sh\necho 0.1.0+12.g1a2b3c4\n")
    python.chmod(0o755)
    unit = root / "usr/lib/systemd/system/contactd.service"
    unit.parent.mkdir(parents=True)
    unit.write_text("[Service]\n" + "# as long as a unit\n" * 400)
    out.mkdir()
    return deb.build(root, out)


def test_it_says_what_it_is_and_which_python_it_needs(made: Path) -> None:
    assert made.name.startswith("contactd_0.1.0+12.g1a2b3c4_")
    about = said("dpkg-deb", "--field", made)
    assert "Version: 0.1.0+12.g1a2b3c4\n" in about
    assert "Depends: python3.11, systemd," in about
    assert f"Architecture: {said('dpkg', '--print-architecture')}" in about
    size = int(said("dpkg-deb", "--field", made, "Installed-Size"))
    assert 8 <= size < 100


def test_a_newer_one_is_newer(made: Path) -> None:
    version = said("dpkg-deb", "--field", made, "Version").strip()
    for older, newer in (("0.1.0", version), (version, "0.1.1"), (version, "0.1.0+13.g0000000")):
        said("dpkg", "--compare-versions", older, "lt", newer)


def test_everything_is_roots_and_nothing_asks_or_overwrites(made: Path, tmp_path: Path) -> None:
    lines = said("dpkg-deb", "--contents", made).splitlines()
    assert {line.split()[1] for line in lines} == {"root/root"}
    said("dpkg-deb", "--control", made, tmp_path / "control")
    inside = {path.name for path in (tmp_path / "control").iterdir()}
    assert inside == {"control", "md5sums", *SCRIPTS}  # no conffiles


@pytest.mark.parametrize("name", SCRIPTS)
def test_its_scripts_are_for_any_shell_and_stop_at_an_error(
    made: Path, tmp_path: Path, name: str
) -> None:
    said("dpkg-deb", "--control", made, tmp_path / "control")
    script = tmp_path / "control" / name
    said("sh", "-n", script)
    text = script.read_text()
    assert text.startswith("#!/bin/sh\n")
    assert "\nset -e\n" in text
    assert script.stat().st_mode & 0o777 == 0o755


def test_dpkg_finds_what_is_damaged(made: Path, tmp_path: Path) -> None:
    said("dpkg-deb", "--raw-extract", made, tmp_path / "raw")
    said("sh", "-c", f"cd {tmp_path / 'raw'} && md5sum --check --strict --quiet DEBIAN/md5sums")
