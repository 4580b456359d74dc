"""Command group `contactd identify`, with a command for each step."""
# ruff: noqa: PLC0415 - each command imports what it needs, so that `--help` starts at once

import sys
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from programs.command_line.options import SOCKET, OrderedGroup
from programs.identify.known_mass import wrench
from programs.identify.step import CONFIG, Step
from programs.identify.steps import STEPS


@click.group(cls=OrderedGroup, invoke_without_command=True)
@CONFIG
@SOCKET
@click.pass_context
def identify(context: click.Context, config: Path | None, socket: Path | None) -> None:
    """Identify an arm's parameters, step by step, on the arm or on recorded logs.

    Without a step: lists the known parameters of each joint, their quality and age, and the next
    command; nothing moves. The options below apply only to this list; each step has its own.

    Without --log, the running daemon moves the arm; the person beside it must have read
    docs/commissioning.md. Each step asks before the arm moves. Drives that are off are enabled for
    the step and switched off after it; the daemon then loads the results. After a fault the step
    offers to reset it. Ctrl-C stops a step at any time: the arm holds, and the same command
    continues from there. Results are written to identified.yaml beside the configuration.
    """
    if context.invoked_subcommand is None:
        from programs.identify.identification import show_overview

        sys.exit(0 if show_overview(config, socket) else 1)
    given = {context.get_parameter_source(option) for option in ("config", "socket")}
    if ParameterSource.COMMANDLINE in given:
        raise click.UsageError("--config and --socket must follow the step's name")


def _command(step: Step) -> click.Command:
    def call(
        config: Path | None,
        socket: Path | None,
        dry_run: bool,
        logs: tuple[Path, ...] = (),
        yes: bool = False,
        **own: Any,
    ) -> None:
        from programs.identify.identification import open_identification

        with open_identification(config, logs, socket, dry=dry_run, yes=yes) as identification:
            sys.exit(0 if step.run(identification, **own) else 1)

    for option in reversed(step.options):
        option(call)
    return click.command(step.name, help=step.run.__doc__)(call)


for _step in STEPS.values():
    identify.add_command(_command(_step))
identify.add_command(wrench)
