"""`contactctl payload`: announces or shows the payload in the hand."""
# ruff: noqa: PLC0415 - messages are imported by the function that needs them

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
    help="Centre of mass in the frame of the URDF's last link, in m; by default the tool point "
    "that `status` shows.",
)
@click.option(
    "--box",
    nargs=3,
    type=float,
    metavar="X Y Z",
    help="Edge lengths of a box about that centre, along that link's axes, in m: shapes keep it "
    "away from the arm and its surroundings. Without it, its size is ignored.",
)
@click.pass_obj
def payload(
    options: Options,
    what: str | None,
    com: tuple[float, float, float] | None,
    box: tuple[float, float, float] | None,
) -> None:
    """Announce the payload in the hand, by its mass in kg or its name in the configuration, or
    `none`.

    From the next tick on the model includes it as a point mass, so that contacts are detected as
    without it. Without an argument: shows the announced payload and the known names. Refused while
    the arm is led, and if the motors could not hold it. Forgotten when the daemon ends.
    """
    from daemon.protocol.requests import SetPayload

    beside = [f"--{name}" for name, given in (("com", com), ("box", box)) if given is not None]
    if what is None:
        if beside:
            raise click.UsageError(f"{beside[0]} requires a mass")
        _show_payload(options)
        return
    try:
        mass = float(what)
    except ValueError:
        if beside:
            raise click.UsageError(
                f"{beside[0]} requires a mass in kg, {what!r} is a name"
            ) from None
        request = SetPayload(name=what)
    else:
        if not math.isfinite(mass):
            raise click.UsageError(f"{what} is not a mass")
        for option, given, what_it_is in (("--com", com, "place"), ("--box", box, "size")):
            if given is not None and not all(map(math.isfinite, given)):
                text = f"{option} {' '.join(map(str, given))} is not a {what_it_is}"
                raise click.UsageError(text)
        request = SetPayload(mass=mass, com=com and list(com), box=box and list(box))
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
