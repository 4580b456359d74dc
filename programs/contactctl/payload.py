"""`contactctl payload`: the payload in the hand, announced or shown."""
# ruff: noqa: PLC0415 - messages are imported by what needs them

import math

import click

from programs.command_line.options import Command, Options
from programs.contactctl.replies import answer, print_json


@click.command(cls=Command, context_settings={"ignore_unknown_options": True})
@click.argument("what", required=False, metavar="[MASS|NAME|none]")
@click.option(
    "--com",
    nargs=3,
    type=float,
    metavar="X Y Z",
    help="Centre of the mass in the frame of the URDF's last link, in m; without it, the point "
    "that `status` calls the tool.",
)
@click.pass_obj
def payload(options: Options, what: str | None, com: tuple[float, float, float] | None) -> None:
    """Announce the payload in the hand, by its mass in kg or its name in the configuration, or
    `none`.

    From the next tick on the model includes it as a point mass: contacts are detected as without
    it. Without an argument: shows the announced payload and the known names. Refused while the arm
    is guided, and if the motors could not hold it. Forgotten when the daemon ends.
    """
    from daemon.protocol.requests import SetPayload

    if what is None:
        if com is not None:
            raise click.UsageError("--com belongs to a mass")
        _show_payload(options)
        return
    try:
        mass = float(what)
    except ValueError:
        if com is not None:
            raise click.UsageError(f"--com belongs to a mass in kg, {what!r} is a name") from None
        request = SetPayload(name=what)
    else:
        if not math.isfinite(mass):
            raise click.UsageError(f"{what} is not a mass")
        if com is not None and not all(map(math.isfinite, com)):
            raise click.UsageError(f"--com {' '.join(map(str, com))} is not a place")
        request = SetPayload(mass=mass, com=None if com is None else list(com))
    with options.connect() as client:
        answer(options, client.ask(request))


def _show_payload(options: Options) -> None:
    with options.connect() as client:
        found = client.ask_status()
    if options.json:
        print_json({"payload": found.payload, "hand": found.hand, "payloads": found.payloads})
        return
    from programs.clients.payload import payload_in_words

    click.echo(payload_in_words(found))
    for one in found.payloads:
        click.echo(f"  {one}")
