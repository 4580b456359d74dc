"""`contactctl` against a daemon that answers, refuses, is slow, or is not there."""

import io
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result
from rich.console import Console

from daemon.protocol.requests import COMMANDS
from programs.command_line import console
from programs.contactctl import contactctl
from programs.contactd import contactd

ROOT = Path(contactctl.__file__).parents[2]
Run = Callable[..., Result]
PAUSED = "the trajectory is paused; the arm holds once it is released"


@pytest.mark.parametrize("command", ["start", "arm", "disarm", "reset"])
def test_done_is_one_line(run: Run, fake_daemon: Any, command: str) -> None:
    result = run(command)
    assert (result.exit_code, result.stdout, result.stderr) == (0, f"{command} done\n", "")
    assert [name for name, _ in fake_daemon.seen if name != "status"] == [command]


@pytest.mark.parametrize(
    "command", ["enable", "start", "pause", "arm", "disarm", "stop", "disable", "reset"]
)
def test_refusal_lists_every_reason(run: Run, fake_daemon: Any, command: str) -> None:
    fake_daemon.refusals[command] = ["first reason", "second reason"]
    fake_daemon.mode = "faulted"  # and still the refusal is what is said
    result = run(command)
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr.splitlines() == [
        f"contactctl: {command} is refused",
        "  - first reason",
        "  - second reason",
    ]
    assert [name for name, _ in fake_daemon.seen if name != "status"] == [command]


@pytest.mark.parametrize(
    ("command", "before", "modes", "exit_code", "said"),
    [
        ("enable", "off", ["off", "enabling", "holding"], 0, "holding: because of holding"),
        ("enable", "off", ["off", "enabling", "off"], 1, "not holding but off: because of off"),
        ("enable", "enabling", ["off"], 1, "not holding but off: because of off"),
        ("enable", "off", ["enabling", "faulted"], 1, "not holding but faulted"),
        ("enable", "off", ["enabling"], 1, "not holding after 0 s enabling"),
        ("disable", "holding", ["off"], 0, "off: because of off"),
        ("disable", "tracking", ["tracking", "stopping", "off"], 0, "off: because of off"),
        ("disable", "tracking", ["stopping", "faulted"], 1, "not off but faulted"),
        ("stop", "tracking", ["tracking", "stopping", "holding"], 0, "holding"),
        ("pause", "tracking", ["stopping", "holding"], 0, "holding: because of holding"),
        # What is so already, the answer to the command says.
        ("stop", "faulted", ["faulted"], 0, "stop done\n"),
        ("stop", "off", ["off"], 0, "stop done\n"),
        ("disable", "off", ["off"], 0, "disable done\n"),
        ("pause", "holding", ["holding"], 0, "pause done\n"),
        # Who guides the arm may do so for minutes.
        ("pause", "admittance", ["admittance"], 0, f"admittance: {PAUSED}"),
        ("pause", "retracting", ["retracting"], 0, f"retracting: {PAUSED}"),
        ("pause", "tracking", ["stopping", "admittance"], 0, PAUSED),
        ("stop", "admittance", ["stopping", "admittance"], 1, "not holding after 0 s admittance"),
        ("disarm", "stopping", ["stopping", "holding"], 0, "holding: because of holding"),
        ("disarm", "stopping", ["stopping"], 1, "not holding after 0 s stopping"),
        ("reset", "faulted", ["off"], 0, "reset done\n"),
        ("reset", "faulted", ["off", "off", "faulted"], 1, "a new fault: because of faulted"),
        ("reset", "faulted", ["faulted"], 1, "a new fault: because of faulted"),
    ],
)
def test_commands_wait_until_the_mode_is_reached(
    run: Run, fake_daemon: Any, command: str, before: str, modes: Any, exit_code: int, said: str
) -> None:
    fake_daemon.mode, fake_daemon.trajectory = before, "paused"
    fake_daemon.modes[command] = modes
    result = run(command)
    assert result.exit_code == exit_code
    assert said in (result.stderr if exit_code else result.stdout)
    assert fake_daemon.mode == modes[-1]


def test_pause_while_guided_without_a_trajectory(run: Run, fake_daemon: Any) -> None:
    fake_daemon.mode = "admittance"
    result = run("pause")
    assert (result.exit_code, result.stdout) == (
        0,
        "admittance: no trajectory will continue; the arm holds once it is released\n",
    )


@pytest.mark.parametrize(
    ("command", "mode"),
    [("stop", "faulted"), ("disarm", "faulted"), ("disable", "off"), ("stop", "off")],
)
def test_a_stop_is_done_when_every_joint_is_confirmed_at_standstill(
    run: Run, fake_daemon: Any, command: str, mode: str
) -> None:
    fake_daemon.mode, fake_daemon.unproved = mode, ["LElbowRoll", "LWristYaw"]
    fake_daemon.proves_after = 3
    result = run(command)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == f"{mode}: because of {mode}\n"
    assert [name for name, _ in fake_daemon.seen] == [command, "status", "status", "status"]


@pytest.mark.parametrize("silenced", [False, True])
@pytest.mark.parametrize("no_wait", [(), ("--no-wait",)])
@pytest.mark.parametrize(
    ("command", "mode"), [("stop", "faulted"), ("disarm", "faulted"), ("disable", "off")]
)
def test_a_stop_without_confirmed_standstill_is_a_failure(
    run: Run, fake_daemon: Any, command: str, mode: str, no_wait: tuple[str, ...], silenced: bool
) -> None:
    fake_daemon.mode, fake_daemon.unproved = mode, ["LElbowRoll", "LWristYaw"]
    fake_daemon.silenced = silenced
    result = run(command, *no_wait)
    assert (result.exit_code, result.stdout) == (1, "")
    first, *others = result.stderr.splitlines()
    assert first == (
        "contactctl: not seen to stand: LElbowRoll, LWristYaw; press the emergency stop if it moves"
    )
    where = f"  - {command} done" if no_wait else f"  - {mode}: because of {mode}"
    silent = ["  - contactd sends nothing to the drives until `reset`"] if silenced else []
    assert others == [where, *silent]
    answer = json.loads(run("--json", command, *no_wait).stdout)
    assert (answer["ok"], answer["unproved"]) == (False, ["LElbowRoll", "LWristYaw"])


@pytest.mark.parametrize("command", ["enable", "pause", "stop", "disable", "disarm"])
def test_no_wait_returns_at_once(run: Run, fake_daemon: Any, command: str) -> None:
    result = run(command, "--no-wait")
    assert (result.exit_code, result.stdout) == (0, f"{command} done\n")
    assert [name for name, _ in fake_daemon.seen if name != "status"] == [command]


def test_json_of_a_command(run: Run, fake_daemon: Any) -> None:
    fake_daemon.modes["enable"] = ["enabling", "holding"]
    answer = json.loads(run("--json", "enable").stdout)
    assert answer == {"ok": True, "message": "holding: because of holding", "mode": "holding"}
    fake_daemon.refusals["arm"] = ["because"]
    result = run("--json", "arm")
    assert result.exit_code == 1
    assert result.stdout.count("\n") == 1
    assert json.loads(result.stdout)["reasons"] == ["because"]


def test_status(run: Run) -> None:
    result = run("status")
    assert result.exit_code == 0
    check = "failed  residual        LWristYaw feels +0.30 Nm"
    for word in ("OFF", "not armed", check, "memory not locked", "3 missed"):
        assert word in result.stdout
    assert "\x1b" not in result.stdout
    assert all(line == line.rstrip() for line in result.stdout.splitlines())
    assert json.loads(run("--json", "status").stdout)["pid"] == 4711


@pytest.mark.parametrize(("height", "heads"), [(20, 2), (200, 1)])
def test_status_shows_the_mode_at_the_end_of_a_small_terminal(
    run: Run, monkeypatch: pytest.MonkeyPatch, height: int, heads: int
) -> None:
    written = io.StringIO()
    terminal = Console(width=80, height=height, file=written, force_terminal=True, no_color=True)
    monkeypatch.setattr(console, "on_stdout", lambda: terminal)
    assert run("status").exit_code == 0
    shown = re.sub(r"\x1b\[[0-9;]*m", "", written.getvalue())
    assert len(re.findall(r"^mode +OFF", shown, re.MULTILINE)) == heads


def test_refused_status(run: Run, fake_daemon: Any) -> None:
    fake_daemon.refusals["status"] = ["not yet"]
    result = run("status")
    assert (result.exit_code, result.stderr) == (1, "contactctl: status is refused; not yet\n")


def path_options(group: click.Group) -> Iterator[click.Parameter]:
    for command in group.commands.values():
        yield from (one for one in command.params if isinstance(one.type, click.Path))
        if isinstance(command, click.Group):
            yield from path_options(command)


def test_files_without_permission_are_not_left_to_click() -> None:
    """Not click, whose exit status is that of a wrong command line."""
    found = [one for main in (contactd.main, contactctl.main) for one in path_options(main)]
    assert {one.name for one in found} >= {"config", "socket", "file", "output", "hand", "logs"}
    assert [one.name for one in found if one.type.readable] == []


@pytest.mark.parametrize(
    "arguments", [["fly"], ["arm", "now"], ["record"], ["record", "x", "--seconds", "0"], ["watch"]]
)
def test_a_wrong_command_line_exits_with_2(run: Run, arguments: list[str]) -> None:
    assert run(*arguments).exit_code == 2


@pytest.mark.parametrize(
    ("arguments", "option", "values", "allowed"),
    [
        (["start", "move.csv"], "--speed", ["nan", "inf", "1e-300", "0", "1.01"], "0.01<=x<=1"),
        (["arm"], "--lease", ["nan", "inf", "0", "86401"], "0.05<=x<=86400"),
        (["record", "x.csv"], "--seconds", ["nan", "0", "-1"], "x>0"),
    ],
)
def test_a_number_out_of_range_is_refused_at_its_option(
    run: Run, fake_daemon: Any, arguments: list[str], option: str, values: list[str], allowed: str
) -> None:
    for value in values:
        result = run(*arguments, option, value)
        assert result.exit_code == 2
        assert f"Invalid value for '{option}': {float(value)} is not in the range" in result.stderr
        assert allowed in result.stderr
    assert not fake_daemon.seen


def test_the_gain_of_an_unknown_joint_is_refused(run: Run, fake_daemon: Any) -> None:
    for value in ([], ["0.1"]):
        result = run("gain", "NoSuch\udcff", *value)
        assert (result.exit_code, result.stdout) == (1, "")
        refused, reason = result.stderr.splitlines()
        assert refused == "contactctl: gain: refused"
        assert reason.startswith("  - no joint 'NoSuch\\udcff'; there are: LShoulderPitch, LSh")
        assert json.loads(run("--json", "gain", "NoSuch", *value).stdout)["ok"] is False
    assert {command for command, _ in fake_daemon.seen} == {"status"}


@pytest.mark.parametrize("program", [contactctl, contactd])
def test_help_shows_whole_sentences(program: Any) -> None:
    _, _, commands = CliRunner().invoke(program.main, ["--help"]).stdout.partition("Commands:")
    assert ("..." in commands, "moves" in commands or "detect contact" in commands) == (False, True)


@pytest.mark.parametrize(("program", "other"), [(contactctl, "contactd"), (contactd, "contactctl")])
def test_an_unknown_command_lists_all_and_names_the_other_program(program: Any, other: str) -> None:
    said = CliRunner().invoke(program.main, ["nothing"]).output
    assert all(name in said for name in (*program.main.commands, f"more are commands of `{other}`"))


def test_help_lists_every_exit_status() -> None:
    text = " ".join(CliRunner().invoke(contactctl.main, ["--help"]).stdout.split())
    listed = text.split("Exit status: ")[1].split(".")[0]
    assert re.findall(r"\b[0-9]+\b", listed) == ["0", "1", "2", "65", "69", "141"]


SESSIONS = {
    "README.md": r"^    \.venv/bin/contactctl (\w+)",
    "docs/operating.md": r"^    contactctl (\w+)",
    "docs/operating.md, the table": r"^\| `(\w+)[ `]",
    "contactctl --help": r"(?<=[:;,] )(?:then )?(\w+)(?=[,;.]| or)",
}


@pytest.mark.parametrize("page", SESSIONS)
def test_a_session_has_one_order_everywhere(page: str) -> None:
    order = list(contactctl.main.commands)
    path = ROOT / page.split(",", maxsplit=1)[0]
    text = path.read_text() if path.exists() else str(contactctl.main.help).split("\n\n")[1]
    reported = [word for word in re.findall(SESSIONS[page], text, re.MULTILINE) if word in order]
    reported = [word for word in reported if word not in ("status", "watch")]
    assert reported[:3] == ["enable", "arm", "start"]
    assert reported == sorted(reported, key=order.index)


def test_its_commands_are_the_daemons_without_those_for_programs() -> None:
    of_programs = {"subscribe", "load", "renew", "target"}
    its_own = {"hand", "health", "home", "touches", "watch", "record", "playback"}
    assert set(contactctl.main.commands) == set(COMMANDS) - of_programs | its_own


@pytest.mark.parametrize(("word", "also"), [("--help", {"rich", "msgspec"}), ("stop", {"rich"})])
def test_commands_start_without_slow_modules(fake_daemon: Any, word: str, also: set[str]) -> None:
    program = (
        "import sys; from programs.contactctl.contactctl import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit: pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    command = [sys.executable, "-c", program, "--socket", str(fake_daemon.path), word]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    heavy = {"numpy", "pinocchio", "can", "canopen", "mcap", "yaml", *also}
    loaded = set(done.stderr.split())
    assert "click" in loaded
    assert heavy & loaded == set()


def process_of(fake_daemon: Any) -> list[str]:
    """Words that start `contactctl` as a process."""
    main = "from programs.contactctl.contactctl import main; main()"
    return [sys.executable, "-c", main, "--socket", str(fake_daemon.path)]


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_commands_are_done_without_a_reader(fake_daemon: Any, closed: str) -> None:
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh", *process_of(fake_daemon), "stop"]
    done = subprocess.run(shell, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert fake_daemon.seen[0][0] == "stop"


@pytest.mark.parametrize("command", [["stop"], ["status"], ["--json", "status"]])
def test_output_to_a_full_device_is_one_error(fake_daemon: Any, command: list[str]) -> None:
    words = [*process_of(fake_daemon), *command]
    at = {"cwd": ROOT, "stderr": subprocess.PIPE, "text": True}
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, stdout=full, check=False, **at)
    assert done.stderr == "contactctl: cannot write the output: No space left on device\n"
    assert done.returncode == 65
    assert [seen for seen, _ in fake_daemon.seen] == [one for one in command if one[0] != "-"]
