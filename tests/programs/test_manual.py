"""Manual pages and completions, tried by `man` and bash where they are."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

from programs.manual import PROGRAMS, write

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def share(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("share")
    write(folder)
    return folder


def test_it_writes_what_make_install_links(share: Path) -> None:
    words = ["make", "-s", "--no-print-directory", "-C", str(ROOT), "-f", "-", "list"]
    text = "include Makefile\nlist:\n\t@echo $(PAGES)\n"
    listed = subprocess.run(words, input=text, capture_output=True, text=True, check=True)
    written = {str(path.relative_to(share)) for path in share.rglob("*") if path.is_file()}
    assert written == set(listed.stdout.split())


@pytest.mark.parametrize("program", PROGRAMS)
def test_man_shows_every_command_and_option(share: Path, program: str) -> None:
    if not shutil.which("man") or not shutil.which("groff"):
        pytest.skip("needs man and groff")
    page = share / f"man/man1/{program}.1"
    environment = {**os.environ, "MANWIDTH": "200", "MAN_KEEP_FORMATTING": "", "LC_ALL": "C.UTF-8"}
    done = subprocess.run(
        ["man", "--warnings", "--local-file", str(page)],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    shown = " ".join(done.stdout.split())
    command = PROGRAMS[program]
    assert f"{program} -" in shown
    for one in [command, *getattr(command, "commands", {}).values()]:
        for parameter in one.params:
            if isinstance(parameter, click.Option) and not parameter.hidden:
                assert parameter.opts[0] in shown, (one.name, parameter.opts)
    for name in getattr(command, "commands", {}):
        assert f"{program} {name} " in shown
    assert "Exit status:" in shown or program == "contactd-web"


@pytest.mark.parametrize(
    ("program", "words", "completed"),
    [
        ("contactctl", ["ena"], {"enable"}),
        ("contactctl", ["dis"], {"disarm", "disable"}),
        ("contactctl", ["go", "--s"], {"--speed", "--socket"}),
        ("contactd", ["simul"], {"simulate"}),
        ("contactd-web", ["--hel"], {"--help"}),
        ("contactd-zenoh", ["--distro", "ja"], {"jazzy"}),
    ],
)
def test_bash_completes(share: Path, program: str, words: list[str], completed: set[str]) -> None:
    if not shutil.which("bash"):
        pytest.skip("needs bash")
    script = (
        f'source "$0"; COMP_WORDS=({program} {" ".join(words)}); COMP_CWORD={len(words)}; '
        f"_{program.replace('-', '_')}_completion {program}; "
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", script, str(share / f"bash-completion/completions/{program}")],
        capture_output=True,
        text=True,
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
        check=False,
    )
    assert (set(done.stdout.split()), done.stderr) == (completed, "")
