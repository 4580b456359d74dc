"""Command line of `contactd-zenoh`, the bridge to ROS 2."""
# ruff: noqa: PLC0415 - zenoh is an extra, and only this program needs it

import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

import click

from common.errors import ConfigurationError, ContactdError
from contactd_client.paths import usual_socket_path, view_socket_path
from programs.command_line.options import PATH
from programs.zenoh.zenoh_options import zenoh_options

EXTRA = frozenset({"zenoh", "xxhash"})
HEARD_WITHIN_S = 0.5  # polling period for signals that a thread of Zenoh received
NICE: Final = 10
END_S = 3.0  # longer than the timeout of a silent daemon


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--view-socket",
    type=PATH,
    metavar="PATH",
    help="View socket of the daemon, instead of the default.",
)
@click.option(
    "--control-socket",
    type=PATH,
    metavar="PATH",
    help="Control socket of the daemon: also offers the service `reset`.",
)
@click.option(
    "--allow-arm",
    is_flag=True,
    help="With --control-socket: also offers the service `arm`, to every client of the router.",
)
@click.option(
    "--allow-follow",
    is_flag=True,
    help="With --control-socket: also accepts targets on `joint_targets`: the arm moves.",
)
@click.option(
    "--namespace",
    default="/contactd",
    show_default=True,
    metavar="NAME",
    help="Namespace of the node and its topics, different for each arm; / for none.",
)
@zenoh_options
@click.version_option(package_name="contactd", prog_name="contactd-zenoh")
def main(
    view_socket: Path | None,
    control_socket: Path | None,
    allow_arm: bool,
    allow_follow: bool,
    connect: tuple[str, ...],
    configuration: Path | None,
    namespace: str,
    domain: int,
    distro: str,
) -> None:
    """Connect an arm to ROS 2 by Zenoh, as a node that is compatible with rmw_zenoh_cpp.

    Topics: joint_states, external_torque, contact_threshold, contact, robot_description,
    /diagnostics. Services: stop, disarm. Nothing else is accepted from the network without
    --control-socket and --allow-arm or --allow-follow; nothing can enable the arm: docs/ros.md.

    Exit status: 0 ended by a signal, 2 usage, 78 wrong configuration.
    """
    for given, option in ((allow_arm, "--allow-arm"), (allow_follow, "--allow-follow")):
        if given and control_socket is None:
            raise click.UsageError(f"{option} needs --control-socket")
    try:
        from programs.zenoh.names import Distro, Node, checked_namespace
        from programs.zenoh.serve import Settings, serve

        settings = Settings(
            view=view_socket or view_socket_path(usual_socket_path()),
            control=control_socket,
            node=Node(domain, checked_namespace(namespace), "contactd", Distro(distro)),
            connect=connect,
            configuration=configuration,
            arming=allow_arm,
            following=allow_follow,
        )
        ended = threading.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: ended.set())
        os.setpriority(os.PRIO_PROCESS, 0, NICE)  # lower priority than the daemon's loop
        _run(lambda: serve(settings, _say, ended), ended)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] not in EXTRA:
            raise
        _end(ConfigurationError("needs the extra `ros`: pip install 'contactd[ros]'"))
    except ContactdError as error:
        _end(error)


def _say(text: str) -> None:
    click.echo(f"contactd-zenoh: {text}")


def _run(serve: Callable[[], None], ended: threading.Event) -> None:
    """Serve in a thread, so that signals are handled while Zenoh waits for a missing router.

    That wait cannot be interrupted. The process then exits by `os._exit`, as Python's regular exit
    would find a thread inside Zenoh.
    """
    errors: list[BaseException] = []

    def work() -> None:
        try:
            serve()
        except BaseException as error:
            errors.append(error)
        ended.set()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    while not ended.wait(HEARD_WITHIN_S):
        pass
    thread.join(END_S)
    if errors:
        raise errors[0]
    if thread.is_alive():
        sys.stdout.flush()
        os._exit(0)


def _end(error: ContactdError) -> None:
    click.echo(f"contactd-zenoh: {error}", err=True)
    sys.exit(error.exit_code)


if __name__ == "__main__":
    main(prog_name="contactd-zenoh")
