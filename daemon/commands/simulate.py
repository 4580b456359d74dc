"""`contactd simulate`: the simulated arm at the other end of the bus, in a process of its own."""

import sys
from pathlib import Path

import msgspec

from daemon.commands.simulated_robot import true_arm
from daemon.config.load import Robot
from daemon.protocol.socket_path import default_hand_path
from daemon.service.realtime import go_realtime
from errors import ConfigurationError
from simulator.hand import read_script
from simulator.server import serve, serve_on_bus


def run_simulation(
    robot: Robot, seed: int | None, friction: str | None, hand: Path | None, door: Path | None
) -> None:
    """Serve until SIGTERM or SIGINT; `door` is the socket of the live hand, where it is not the
    usual one. Raises ContactdError."""
    description, simulation = true_arm(robot)
    chosen = {"seed": seed, "friction": friction}
    changes = {name: value for name, value in chosen.items() if value is not None}
    settings = msgspec.structs.replace(simulation.settings, **changes)
    script = read_script(hand) if hand else ()
    # Real drives are punctual; simulated ones need real-time priority for it.
    go_realtime()
    bus = robot.configuration.bus
    events, door = sys.stdout.buffer, door or default_hand_path()
    match bus.interface:
        case "socketcand":
            serve(
                description,
                settings,
                host=bus.host,
                port=bus.port,
                hand_script=script,
                events=events,
                hand_door=door,
            )
        case "socketcan":
            serve_on_bus(
                description,
                settings,
                interface=bus.interface,
                channel=bus.channel,
                hand_script=script,
                events=events,
                hand_door=door,
            )
        case other:
            raise ConfigurationError(
                f"{robot.path}: bus.interface: {other} cannot be simulated by another process; "
                "use socketcand (over TCP) or socketcan (a real or virtual CAN interface)"
            )
