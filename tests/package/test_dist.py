"""Wheel and source archive, away from the clone."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import sysconfig
import tarfile
import urllib.request
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from version import version

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = {"beam_arm", "desk_arm", "openarm_left", "romeo_left_arm", "single_joint"}


def run(*words: str | Path, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """A command with next to nothing in its environment."""
    known = {"PATH": os.environ["PATH"], "HOME": str(cwd), **more}
    return subprocess.run(
        [str(word) for word in words],
        cwd=cwd,
        env=known,
        capture_output=True,
        text=True,
        check=True,
    )


def build(root: Path, out: Path, target: str, **more: str) -> Path:
    """Archives that hatchling makes of `root`, in `out`."""
    words = (sys.executable, "-m", "hatchling", "build", "-t", target, "-d", out)
    run(*words, cwd=root, **more)
    (made,) = out.glob("*.whl" if target == "wheel" else "*.tar.gz")
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, tmp_path_factory.mktemp("wheel"), "wheel")


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, tmp_path_factory.mktemp("archive"), "sdist")


@pytest.fixture(scope="module")
def away(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel, and of ours only the packages of others."""
    place = tmp_path_factory.mktemp("away")
    venv.create(place / "env", with_pip=False, symlinks=True)
    python = place / "env/bin/python"
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python)
    run(*pip, "install", "--quiet", "--no-index", "--no-deps", wheel, cwd=place)
    words = ("-c", "import sysconfig; print(sysconfig.get_path('purelib'))")
    there = Path(run(python, *words, cwd=place).stdout.strip())
    # A folder that stands in a .pth has none of its own followed: that of our clone is not.
    others = f"{sysconfig.get_path('purelib')}\nimport cmeel_pth\n"
    (there / "others.pth").write_text(others)
    return place


def names(archive: Path) -> set[str]:
    with tarfile.open(archive) as file:
        return {name.partition("/")[2] for name in file.getnames()}


def test_nothing_of_the_clone_is_needed(away: Path) -> None:
    words = ("-c", "import daemon.run, contactd_client, simulator, sys; print(sys.path)")
    assert str(ROOT) + "'" not in run(away / "env/bin/python", *words, cwd=away).stdout
    assert run(away / "env/bin/contactd", "--version", cwd=away).stdout.split()[-1] == version(ROOT)
    # It would say so of modules that run plain.
    assert run(away / "env/bin/python", "-P", "-m", "common.compiled", cwd=away).stdout == ""


def test_the_examples_are_there_and_no_other_arm(away: Path) -> None:
    (configs,) = (away / "env").rglob("site-packages/configs")
    assert {path.name for path in configs.iterdir()} == EXAMPLES
    assert not list(configs.rglob("*.mcap"))
    for name in EXAMPLES:
        run(away / "env/bin/contactd", "check", configs / name, cwd=away)


@pytest.fixture
def demo(away: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`contactd demo --web` as it runs, and the page's address."""
    words = [str(away / "env/bin/contactd"), "demo", "--web", "--web-port", "0"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(words, cwd=away, text=True, start_new_session=True, **pipes) as process:  # type: ignore[call-overload]
        said = ""
        try:
            while not (found := re.search(r"http://\S+", said)):
                line = process.stdout.readline()
                assert line, said
                said += line
            yield process, found[0]
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def test_the_demo_runs_and_shows_the_page(demo: tuple[subprocess.Popen[str], str]) -> None:
    process, url = demo
    page = urllib.request.urlopen(url, timeout=60).read().decode()
    assert "<title>contactd" in page
    (script,) = re.findall(r'src="([^"]+\.js)"', page)
    assert urllib.request.urlopen(f"{url.rstrip('/')}/{script.lstrip('/')}", timeout=60).read()
    os.killpg(process.pid, signal.SIGINT)
    process.communicate()
    assert process.returncode == 130


def test_the_archive_has_what_tests_and_install_need_and_nothing_that_was_built(
    archive: Path,
) -> None:
    there = names(archive)
    for name in ("Makefile", "systemd/contactd.service", "docs/installing.md", "requirements.lock"):
        assert name in there
    assert "tests/programs/clients/format_7.mcap" in there
    strange = re.compile(r"\.so$|__pycache__|node_modules|^build/|^\.venv|compiled\.json$")
    assert not [name for name in there if strange.search(name)]


def test_without_git_the_archive_makes_the_same_wheel(
    archive: Path, wheel: Path, tmp_path: Path
) -> None:
    with tarfile.open(archive) as file:
        file.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    # As plain Python: compiling takes a minute, and has tests of its own.
    plain = build(source, tmp_path / "out", "wheel", CC="false")
    assert plain.name.startswith(f"contactd-{version(ROOT)}-py3-none-any")

    def content(path: Path) -> dict[str, int]:
        with zipfile.ZipFile(path) as file:
            infos = file.infolist()
        built = (".so", "compiled.json", "WHEEL", "RECORD")
        return {info.filename: info.CRC for info in infos if not info.filename.endswith(built)}

    assert content(plain) == content(wheel)
