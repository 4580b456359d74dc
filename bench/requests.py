"""Odd requests to the daemon as it runs: whether one ends it, or gets no answer.

    python -m bench.requests [--seconds S] [--seed N] [--json]

`contactd run` and `contactd simulate` are processes of their own, on every configuration in
configs/, in real time. Each command is sent with fields from sound to absurd
(bench/rigs/odd_requests.py). Now and then the arm is enabled, and a latched fault reset.
"""

import itertools
import json
import socket
import time
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path

import click

from bench.options import SEED, command
from bench.report import Target, print_report
from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT
from bench.rigs.odd_requests import OddRequests
from bench.rigs.processes import Pair, pair
from daemon.config.load import load_robot
from daemon.protocol.requests import COMMANDS, Command

ROBOTS = (SINGLE_JOINT, DESK_ARM, ROMEO)
PATIENCE_S = 10.0  # a `reload` sets all drives up anew
AGAIN_EVERY = 50
# A `reload` takes seconds, in which nothing else is tried.
MIXED: tuple[Command, ...] = (*(c for c in COMMANDS if c != "reload"),) * 30 + ("reload",)


@dataclass(slots=True)
class Outcome:
    """What became of the requests to one arm."""

    arm: str
    requests: int = 0
    missed: list[str] = field(default_factory=list)  # requests without an answer
    broken: list[str] = field(default_factory=list)  # answers that say `internal error`
    done: dict[str, int] = field(default_factory=dict)  # commands that were carried out
    slowest_s: float = 0.0
    ended: str = ""  # how the daemon ended while it was asked


def besiege(both: Pair, odd: OddRequests, seed: int, seconds: float, outcome: Outcome) -> None:
    """Send odd requests for so long."""
    until = time.monotonic() + seconds
    for number, packet in enumerate(odd.packets(seed, MIXED)):
        if time.monotonic() > until or outcome.ended:
            return
        again = [b'{"command":"reset"}', b'{"command":"enable"}'] * (number % AGAIN_EVERY == 0)
        for one in itertools.chain(again, [packet]):
            _ask(both, one, outcome)


def _ask(both: Pair, packet: bytes, outcome: Outcome) -> None:
    outcome.requests += 1
    began = time.monotonic()
    try:
        with closing(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)) as one:
            one.settimeout(PATIENCE_S)
            one.connect(str(both.door))
            one.send(packet)
            answer = json.loads(one.recv(1 << 20))
    except (OSError, ValueError) as error:
        outcome.missed.append(f"{packet[:200]!r}: {error}")
        if both.daemon.poll() is not None:
            outcome.ended = f"status {both.daemon.returncode}: {both.log.read_text()[-2000:]}"
        return
    outcome.slowest_s = max(outcome.slowest_s, time.monotonic() - began)
    if "internal error" in answer.get("message", ""):
        outcome.broken.append(f"{packet[:200]!r}: {answer['message']}")
    if answer["ok"]:
        command = answer["message"].partition(":")[0]
        outcome.done[command] = outcome.done.get(command, 0) + 1


def outcome_of(robot: Path, seed: int, seconds: float) -> Outcome:
    """Odd requests to the daemon of one configuration."""
    c = load_robot(robot).configuration
    odd, outcome = OddRequests(c.joint_names, list(c.poses), list(c.payloads)), Outcome(c.name)
    with pair(robot) as both:
        client, _, states = both.subscribed()
        with client:
            next(states)
        besiege(both, odd, seed, seconds, outcome)
    return outcome


@command(__doc__)
@click.option("--seconds", default=20.0, help="For each configuration.")
@SEED
def main(seconds: float, seed: int, as_json: bool) -> None:
    outcomes = [outcome_of(robot, seed, seconds) for robot in ROBOTS]
    if not as_json:
        for one in outcomes:
            click.echo(f"{one.arm}: {one.requests} requests, slowest {one.slowest_s:.3f} s")
            for text in [*one.missed, *one.broken, one.ended]:
                click.echo(f"  {text}" if text else "", nl=bool(text))
    ends = sum(bool(one.ended) for one in outcomes)
    missed, broken = (
        sum(len(x) for x in some)
        for some in ([one.missed for one in outcomes], [one.broken for one in outcomes])
    )
    least = min(one.requests for one in outcomes)
    targets = [
        Target("daemon ends / missed answers", ends + missed, 0),
        Target("answers that say `internal error`", broken, 0),
        Target("requests to each arm", least, 10 * seconds, "", "higher"),
    ]
    data = {"seconds": seconds, "arms": [asdict(one) for one in outcomes]}
    print_report("requests", seed, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
