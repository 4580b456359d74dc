"""Every command that the documentation names: run as it stands, or known, with why it is not run.

What no row of NOT_RUN matches is run, against the whole daemon and the simulated arm in lockstep,
in the order of its page. So a new command in a page runs, or a reason stands here. All are looked
up, run or not: programs, commands and options, targets of the Makefile, files, benches.
"""

import importlib
import re
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import click
import pytest
import yaml
from click.testing import CliRunner, Result

from bench.rigs.lockstep import ROMEO
from bench.rigs.recorded_arm import made
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.modes.table import Mode
from docs.commands import OURS, ROOT, Named, commands_of, pages
from programs.command_line.options import Options
from programs.contactctl import contactctl
from programs.contactd import contactd
from programs.foxglove.server import main as contactd_foxglove
from programs.web.contactd_web import main as contactd_web
from programs.zenoh.contactd_zenoh import main as contactd_zenoh

PROGRAMS: Final[dict[str, click.Command]] = {
    "contactctl": contactctl.main,
    "contactd": contactd.main,
    "contactd-foxglove": contactd_foxglove,
    "contactd-web": contactd_web,
    "contactd-zenoh": contactd_zenoh,
}
SERVES = "serves until it is ended"
# Pattern of page and command, and why it is not run here: the first that matches counts.
NOT_RUN: Final = (
    (r"^docs/first_arm\.md ", "is run to its end, on an arm of its own, by the test of that page"),
    (r"^docs/logs\.md ", "is run in its order, on logs of its own, by the test of that page"),
    (r" contactd (run|simulate) ", f"{SERVES}; the rig of this test is both"),
    (r" contactd check /etc/contactd", "is of an installed arm: tests/system"),
    (r" contactd demo", "takes real time: tests/programs/demo/test_demo_story.py"),
    (r" contactd identify ", "takes minutes, some of them a hand's: tests/programs/identify"),
    (r" contactd fleet", "asks a router: tests/programs/zenoh"),
    (r" contactd-(web|zenoh|foxglove)", SERVES),
    (r"^docs/lerobot\.md ", "needs two arms, and LeRobot: `make lerobot`"),
    (r"--socket (leader|follower)\.sock", "needs two arms"),
    (r" contactctl follow ", "takes real time: tests/programs/contactctl/test_follow.py"),
    (r" contactctl watch", "needs a terminal: tests/programs/contactctl/test_live_states.py"),
    (r" contactctl touches", "goes on until Ctrl-C: tests/programs/contactctl/test_contactctl.py"),
    (r" contactctl health", "reads records of days: tests/programs/trends"),
    (r" contactctl hand ", "asks a live simulation: tests/simulator/test_hand_socket.py"),
    (r" contactd plot --last-fault", "needs a fault: tests/programs/recordings/test_recomputed.py"),
    (r" contactd whatif recordings/", "needs workers: tests/programs/recordings/test_whatif.py"),
    (r" make ", "builds, tests or installs"),
    (r" (sudo|export|pip) ", "changes the machine"),
    (r" (ros2|dask) ", "is another program's"),
    (r" python -m bench\.", "takes minutes: tests/bench"),
    (r" python ", "is looked up alone"),
)  # fmt: skip
COMMANDS = [named for page in pages() for named in commands_of(page)]
LINES = [named for named in COMMANDS if not named.mention]


def why_not(named: Named) -> str:
    """Reason why a line is not run; empty for one that is."""
    text = f"{named.page} {named.text} "
    return next((reason for pattern, reason in NOT_RUN if re.search(pattern, text)), "")


RUN = [named for named in LINES if not why_not(named)]


# --- all of them are there --------------------------------------------------------------------


@pytest.mark.parametrize("named", COMMANDS, ids=str)
def test_it_is_there(named: Named) -> None:
    look_up(named.words, placeholders=named.mention)


def look_up(words: tuple[str, ...], *, placeholders: bool) -> None:
    """Find a command, its options and, unless they may be placeholders, the kind of its values."""
    match words:
        case ("sudo", *rest):
            look_up((rest[0].removeprefix(".venv/bin/"), *rest[1:]), placeholders=placeholders)
        case ("make", *rest):
            targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
            assert {word for word in rest if "=" not in word} <= set(targets)
        case ("python", "-m", module, *rest) if module.startswith("bench."):
            _options(importlib.import_module(_runnable(module)).main, rest)
        case ("python", file, *_) if file.endswith(".py"):
            assert (ROOT / file).is_file()
        case (program, *rest) if program in OURS:
            if not (placeholders and not rest):
                _found(PROGRAMS[program], program, rest, placeholders=placeholders)


def _runnable(module: str) -> str:
    """The module that `python -m` runs: a package has its command in `__main__`."""
    is_package = (ROOT / module.replace(".", "/")).is_dir()
    return f"{module}.__main__" if is_package else module


def _found(command: click.Command, name: str, words: list[str], *, placeholders: bool) -> None:
    """Walk down groups to the command that the words name, and parse what is left for it."""
    above: click.Context | None = None
    while isinstance(command, click.Group):
        if words in ([], ["--help"]) and placeholders:
            return
        above = command.make_context(name, list(words), parent=above)
        left = [*above._protected_args, *above.args]
        if not left and placeholders:
            return
        _, found, words = command.resolve_command(above, left)
        assert found is not None
        command, name = found, found.name or ""
        # `--json` and `--socket` behind a command change what the program's own call made.
        above.obj = Options(None, json=False)
    if placeholders:
        _options(command, words)
    else:
        command.make_context(name, words, parent=above)


def _options(command: click.Command, words: list[str]) -> None:
    """See that the options are those of the command."""
    options = {option for each in command.params for option in each.opts} | {"--help"}
    assert {word.partition("=")[0] for word in words if re.match(r"--\w", word)} <= options


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("contactctl", "halt"), click.UsageError),
        (("contactctl", "arm", "--leese", "3"), click.UsageError),
        (("contactctl", "gain", "elbow", "soft"), click.UsageError),
        (("contactd", "identify", "gab"), click.UsageError),
        (("sudo", "make", "instal"), AssertionError),
        (("python", "-m", "bench.hands"), ModuleNotFoundError),
        (("python", "-m", "bench.loop", "--fast"), AssertionError),
        (("python", "docs/program.py"), AssertionError),
    ],
)
def test_what_is_not_there_is_found(words: tuple[str, ...], error: type[Exception]) -> None:
    with pytest.raises(error):
        look_up(words, placeholders=False)


def test_a_mention_may_leave_values_open_and_no_option() -> None:
    look_up(("contactctl", "gain", "JOINT", "K_A"), placeholders=True)
    with pytest.raises(AssertionError):
        look_up(("contactctl", "arm", "--leese"), placeholders=True)


# --- and the rest runs ------------------------------------------------------------------------

ASKED = ["go", "home"]  # these ask, and no one is there to answer
NEEDS_POWER = frozenset({"go", "home", "arm", "start"})
POSES = {
    "home": {"LShoulderPitch": 0.5, "LShoulderYaw": 0.3, "LElbowRoll": -0.8, "LElbowYaw": -0.3},
    "work": {"LElbowRoll": -0.4},
}
MOVE = "time_s,LElbowRoll,LElbowYaw\n0,-0.803,-0.3\n2,-0.79,-0.31\n4,-0.803,-0.3\n"
LABELS = "start_s,end_s,joint\n3.0,4.0,any\n"
CUP = {"cup": {"mass": 0.4, "com": [0.1, 0.0, -0.02]}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the pages suppose it: a robot's, its URDF and EDS beside, `configs/my_arm`."""
    top = tmp_path_factory.mktemp("docs")
    arm = top / "configs" / "my_arm"
    shutil.copytree(ROMEO, arm)
    path = arm / "config.yaml"
    c = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump({**c, "poses": POSES, "payloads": CUP}, sort_keys=False))
    for name, copied in (("my_arm.urdf", "arm.urdf"), ("drive.eds", "drive.eds")):
        shutil.copy(ROMEO / copied, top / name)
    return top


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[ServedDaemon]:
    with (
        pytest.MonkeyPatch.context() as patch,
        served_daemon(folder, folder / "configs" / "my_arm") as served,
    ):
        # Commands run in a thread here, which gets no signals: no one interrupts.
        patch.setattr(signal, "signal", lambda *_: signal.SIG_DFL)
        yield served


@pytest.fixture(scope="module")
def recording(folder: Path) -> Path:
    """14 s of the arm at work, for the pages that ask a recording."""
    return made(folder / "demo.mcap", folder / "configs" / "my_arm", 14.0, seed=1)


@pytest.mark.parametrize("page", sorted({named.page for named in RUN}))
def test_the_commands_of_a_page_run(
    page: str,
    folder: Path,
    served: ServedDaemon,
    recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    shutil.copytree(folder / "configs", tmp_path / "configs")
    for file in (folder / "my_arm.urdf", folder / "drive.eds", recording):
        shutil.copy(file, tmp_path)
    shutil.copy(recording, tmp_path / "touch.mcap")
    (tmp_path / "labels.csv").write_text(LABELS)
    (tmp_path / "move.csv").write_text(MOVE)
    monkeypatch.chdir(tmp_path)
    served.contactctl("payload", "none")  # what another page set is in no hand
    for named in (named for named in RUN if named.page == page):
        result = run(named, served)
        assert result.exit_code == 0, f"{named}\n{result.output}"


def run(named: Named, served: ServedDaemon) -> Result:
    """Run a line, from where the arm would be at that place of the page."""
    program, command, *rest = named.words
    if program == "contactd":
        if command == "new":
            shutil.rmtree("configs/my_arm")
        return CliRunner().invoke(contactd.main, [command, *rest], catch_exceptions=False)
    mode = served.rig.mode
    if command in NEEDS_POWER and mode is Mode.OFF:
        served.contactctl("enable")
    if command in ("go", "home", "start") and mode is not Mode.OFF:
        served.contactctl("stop")
    if command == "pause" and mode is Mode.HOLDING:
        served.contactctl("start")
    if command in ASKED and rest:
        rest.append("--yes")
    if command == "home":
        rest = ["--yes"]
    if command == "record":  # one of that name lies there, for pages that only ask it
        Path(rest[0]).unlink(missing_ok=True)
    if command == "enable" and mode is not Mode.OFF:
        served.contactctl("disable")
    return served.contactctl(command, *rest)


def test_no_reason_is_left_over() -> None:
    texts = [f"{named.page} {named.text} " for named in LINES]
    unused = [
        pattern
        for pattern, _ in NOT_RUN
        if not pattern.startswith("^") and not any(re.search(pattern, text) for text in texts)
    ]
    assert unused == []
