"""Command line of `contactd-web`."""
# ruff: noqa: PLC0415 - aiohttp is an extra, and only a server needs it

import os
import sys
from contextlib import closing
from pathlib import Path

import click

from common.errors import ConfigurationError, ContactdError
from contactd_client.paths import usual_socket_path, view_socket_path
from programs.command_line.options import PATH
from programs.zenoh.zenoh_options import DISTROS

EXTRA_OF = {"aiohttp": "web", "zenoh": "ros", "xxhash": "ros"}


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("view_sockets", nargs=-1, type=PATH, metavar="[VIEW_SOCKET]...")
@click.option(
    "--bind",
    default="127.0.0.1",
    show_default=True,
    metavar="ADDRESS",
    help="Address to listen on, or unix:PATH for a proxy on this computer.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=8420, show_default=True)
@click.option(
    "--host",
    "hosts",
    multiple=True,
    metavar="NAME",
    help="Host name in the page's URL, in addition to those of this computer; may be repeated. "
    "Include a port that is not the default: arm.example:8443.",
)
@click.option("--tls", is_flag=True, help="A proxy in front provides TLS: the URL is https.")
@click.option("--read-only", is_flag=True, help="Only show: no stop, no disarm, no recording.")
@click.option(
    "--token-file",
    type=PATH,
    metavar="FILE",
    help="File with the token that each browser must enter once; at least 16 characters.",
)
@click.option(
    "--recordings",
    type=PATH,
    metavar="FOLDER",
    help="Folder for recordings; by default in the state directory.",
)
@click.option("--no-recordings", is_flag=True, help="Do not offer recording.")
@click.option(
    "--fleet",
    metavar="ENDPOINT|FILE.json5",
    help="Also show, and stop, arms of other computers at a Zenoh router, as `contactd fleet` does "
    "(tcp/HOST:7447, or a file with a Zenoh configuration).",
)
@click.option(
    "--domain", type=click.IntRange(0, 232), default=0, help="ROS_DOMAIN_ID of --fleet; 0."
)
@click.option(
    "--distro",
    type=click.Choice(DISTROS),
    default="jazzy",
    help="Distribution of --fleet, as of `contactd fleet`; jazzy.",
)
@click.version_option(package_name="contactd", prog_name="contactd-web")
def main(
    view_sockets: tuple[Path, ...],
    bind: str,
    port: int,
    hosts: tuple[str, ...],
    tls: bool,
    read_only: bool,
    token_file: Path | None,
    recordings: Path | None,
    no_recordings: bool,
    fleet: str | None,
    domain: int,
    distro: str,
) -> None:
    """Serve a page that shows an arm and its contacts, and can stop it.

    VIEW_SOCKET is the view socket of a daemon (contactd-view.sock), one for each arm; by default
    that beside the default control socket. The page can only stop and disarm: it is not an
    emergency stop. Other computers have no access unless --bind permits it; then use a
    --token-file, and read docs/page.md.

    Exit status: 0 ended by a signal, 2 usage, 69 cannot listen there, 78 wrong configuration.
    """
    try:
        from programs.web.serve import listen, serve, settings_of

        with listen(bind, port) as listener:
            settings = settings_of(
                view_sockets or (view_socket_path(usual_socket_path()),),
                bind=bind,
                port=port or listener.getsockname()[1],
                hosts=hosts,
                tls=tls,
                read_only=read_only,
                token_file=token_file,
                recordings=None if no_recordings else recordings or state_folder(),
            )
            if fleet is None:
                serve(settings, listener, click.echo)
                return
            from programs.web.elsewhere import Router

            with closing(Router(fleet, domain, distro)) as others:
                serve(settings, listener, click.echo, others)
    except ModuleNotFoundError as error:
        extra = EXTRA_OF.get((error.name or "").split(".")[0])
        if extra is None:
            raise
        _end(ConfigurationError(f"needs the extra `{extra}`: pip install 'contactd[{extra}]'"))
    except ContactdError as error:
        _end(error)


def state_folder() -> Path:
    """Folder for recordings, in the state directory of the service or the user."""
    if service := os.environ.get("STATE_DIRECTORY"):
        return Path(service.split(":")[0]) / "recordings"
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state"
    return Path(home) / "contactd-web" / "recordings"


def _end(error: ContactdError) -> None:
    click.echo(f"contactd-web: {error}", err=True)
    sys.exit(error.exit_code)


if __name__ == "__main__":
    main(prog_name="contactd-web")
