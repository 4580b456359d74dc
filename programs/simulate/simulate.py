"""`contactd simulate`: simulates the arm in a separate process on the configured bus."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import msgspec

from common.errors import BusError, ConfigurationError
from daemon.config.load import Robot
from daemon.protocol.socket_path import default_hand_path
from daemon.service.realtime import go_realtime
from programs.command_line.sentences import say
from programs.simulate.simulated_robot import refused_drives, supplied_values, true_arm
from simulator.hand_script import read_script
from simulator.hand_socket import HandSocket
from simulator.server import Server, serve, serve_on_bus


def run_simulation(
    robot: Robot, seed: int | None, friction: str | None, hand: Path | None, socket: Path | None
) -> None:
    """Simulate until SIGTERM or SIGINT; `socket`: of the live hand, None for the default.
    Raises ContactdError."""
    description, simulation = true_arm(robot)
    for sentence in (*refused_drives(robot, simulation), *supplied_values(description)):
        say(sentence, err=True)
    chosen = {"seed": seed, "friction": friction}
    changes = {name: value for name, value in chosen.items() if value is not None}
    settings = msgspec.structs.replace(simulation.settings, **changes)
    script = read_script(hand) if hand else ()
    # Simulated drives need real-time priority to be as punctual as real ones.
    go_realtime()
    bus = robot.configuration.bus
    with _live_hand(socket) as live:
        both: dict[str, Any] = {"hand_script": script, "events": sys.stdout.buffer, "hand": live}
        match bus.interface:
            case "socketcand":
                serve(Server(description, settings, host=bus.host, port=bus.port, **both))
            case "socketcan":
                serve_on_bus(
                    description, settings, interface=bus.interface, channel=bus.channel, **both
                )
            case other:
                raise ConfigurationError(
                    f"{robot.path}: bus.interface: {other} cannot be simulated by another process; "
                    "use socketcand (over TCP) or socketcan (a real or virtual CAN interface)"
                )


@contextmanager
def _live_hand(chosen: Path | None) -> Iterator[HandSocket | None]:
    """Context with the socket of the live hand. If another simulation uses the default, there is
    none, with a message. Raises BusError if a chosen one is in use."""
    hand_socket: HandSocket | None = None
    try:
        hand_socket = HandSocket(chosen or default_hand_path())
    except BusError as error:
        if chosen is not None:
            raise
        click.echo(
            f"contactd: no live hand here: {error} (choose another: --hand-socket)", err=True
        )
    try:
        yield hand_socket
    finally:
        if hand_socket is not None:
            hand_socket.close()
