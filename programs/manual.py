"""Manual pages and shell completions of the command lines, written below a folder:

    python -m programs.manual SHARE

They are generated from the texts of `--help`, so that both always agree. `make install` writes them
into the environment and links them to where `man` and the shells look.
"""

import re
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Final

import click
from click.shell_completion import get_completion_class

from programs.contactctl import contactctl
from programs.contactd import contactd
from programs.web import contactd_web
from programs.zenoh import contactd_zenoh

PROGRAMS: Final[dict[str, click.Command]] = {
    "contactd": contactd.main,
    "contactctl": contactctl.main,
    "contactd-web": contactd_web.main,
    "contactd-zenoh": contactd_zenoh.main,
}
# Path below a share/ folder at which each shell looks for a completion.
COMPLETIONS: Final = {
    "bash": "bash-completion/completions/{}",
    "zsh": "zsh/site-functions/_{}",
    "fish": "fish/vendor_completions.d/{}.fish",
}


def write(share: Path) -> None:
    """Write all manual pages and completions below `share`."""
    for program, command in PROGRAMS.items():
        _write(share / f"man/man1/{program}.1", manual(program, command))
        for shell, name in COMPLETIONS.items():
            _write(share / name.format(program), completion(shell, program, command))


def completion(shell: str, program: str, command: click.Command) -> str:
    """Completion script of a program for `shell`, which calls the program itself at each Tab."""
    kind = get_completion_class(shell)
    assert kind is not None
    variable = f"_{program.upper().replace('-', '_')}_COMPLETE"
    complete = kind(command, {}, program, variable)
    return complete.source_template % complete.source_vars()


def manual(program: str, command: click.Command) -> str:
    """Manual page of a program, in man(7) markup, with a section for each command."""
    context = click.Context(command, info_name=program, **command.context_settings)
    lines = [
        f'.TH {program.upper()} 1 "" "contactd {version("contactd")}" "contactd"',
        ".SH NAME",
        f"{_text(program)} \\- {_text(_first_sentence(command))}",
        *_described(context),
    ]
    if isinstance(command, click.Group):
        lines.append(".SH COMMANDS")
        for name in command.list_commands(context):
            lines += _command(
                command.commands[name],
                click.Context(command.commands[name], info_name=name, parent=context),
            )
    lines += [".SH SEE ALSO", ", ".join(f"{_text(name)}(1)" for name in PROGRAMS)]
    return "\n".join(lines) + "\n"


def _described(context: click.Context) -> Iterator[str]:
    command = context.command
    yield from (".SH SYNOPSIS", f".B {_text(context.command_path)}", _usage(context))
    yield from (".SH DESCRIPTION", *_paragraphs(command.help or ""))
    yield from (".SH OPTIONS", *_options(context))


def _command(command: click.Command, context: click.Context) -> Iterator[str]:
    yield f".SS {_text(context.command_path)} {_usage(context)}"
    yield from _paragraphs(command.help or "")
    yield from _options(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.commands[name]
            yield from _command(below, click.Context(below, info_name=name, parent=context))


def _usage(context: click.Context) -> str:
    return _text(" ".join(context.command.collect_usage_pieces(context)))


def _options(context: click.Context) -> Iterator[str]:
    # Options of the program itself may follow each command, but are only listed once.
    above = context.parent.command.get_params(context.parent) if context.parent else []
    listed = {parameter.name for parameter in above}
    for parameter in context.command.get_params(context):
        record = parameter.get_help_record(context)
        if record and parameter.name not in listed:
            yield from (".TP", f".B {_text(record[0])}", _text(record[1]))


def _paragraphs(text: str) -> Iterator[str]:
    for paragraph in text.replace("\b", "").replace("\f", "").split("\n\n"):
        if words := " ".join(paragraph.split()):
            yield from (".PP", _text(words))


def _first_sentence(command: click.Command) -> str:
    return " ".join((command.help or "").split(".")[0].split())


def _text(words: str) -> str:
    """Text escaped for man(7)."""
    escaped = words.replace("\\", "\\e").replace("-", "\\-").replace("\n", " ")
    return re.sub(r"^([.'])", r"\\&\1", escaped)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
