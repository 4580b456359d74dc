"""Every command with odd fields, in the real service: each is answered, and the loop goes on."""

import itertools
import json
import socket
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest

from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import Request
from programs.clients.client import Client
from tests.daemon.service.odd_requests import OddRequests
from tests.examples import scaled

# `reload` sets the drives up anew, and `enable` reads them all: they are tried elsewhere.
QUICK = ("start", "go", "follow", "target", "arm", "renew", "load", "gain", "payload") * 3 + (
    *("status", "subscribe", "pause", "disarm", "stop", "disable", "reset"),
)
CARRIED_OUT = ("start", "go", "load", "gain", "payload", "status")


def asked(served: ServedDaemon, packet: bytes) -> dict[str, Any]:
    """Answer to a packet, within two ticks."""
    with closing(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)) as one:
        one.setblocking(False)
        one.connect(str(served.path))
        one.send(packet)
        served.tick()
        served.tick()
        answer: dict[str, Any] = json.loads(one.recv(1 << 20))
        return answer


def on_again(served: ServedDaemon) -> None:
    """Energise an arm that a request has let go of."""
    if served.rig.mode is Mode.FAULTED:
        served.run(0.3)
        served.rig.reset()
    if served.rig.mode is Mode.OFF:
        served.rig.enable()


@pytest.mark.parametrize("robot", [SINGLE_JOINT, DESK_ARM, ROMEO], ids=lambda path: path.name)
def test_every_odd_request_is_answered_and_no_tick_breaks(
    tmp_path: Path, robot: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with served_daemon(tmp_path, robot) as served:
        # What needs an identified arm is tried on any.
        served.rig.arming.unsettled = list  # type: ignore[method-assign]
        c = served.rig.robot.configuration
        odd = OddRequests(c.joint_names, list(c.poses), list(c.payloads))
        outcomes: Counter[tuple[str, bool]] = Counter()
        least, most = scaled(250), 2500
        for number, packet in enumerate(itertools.islice(odd.packets(1, QUICK), most)):
            if number >= least and all(outcomes[command, True] for command in CARRIED_OUT):
                break
            if number % 20 == 0:
                on_again(served)
            answer = asked(served, packet)
            assert answer["message"], packet
            outcomes[answer["message"].partition(":")[0], answer["ok"]] += 1
    assert not [r.message for r in caplog.records if "internal error" in r.message]
    # They were no empty attempts: of each command some were carried out.
    for command in CARRIED_OUT:
        assert outcomes[command, True], (command, outcomes)
        assert command == "status" or outcomes[command, False] or outcomes["not a request", False]


@pytest.mark.parametrize(
    ("packet", "allowed"),
    [
        ('{"command":"go","targets":{"joint":0.1},"speed":5e-324}', ">= 0.001 - at `$.speed`, not"),
        (
            '{"command":"go","targets":{"joint":0.1},"speed":2.01}',
            "<= 2.0 - at `$.speed`, not 2.01",
        ),
        ('{"command":"go","targets":{"joint":1e308}}', "is outside its limits [-1.4, 1.4] rad"),
        ('{"command":"arm","lease_s":0.049}', ">= 0.05 - at `$.lease_s`, not 0.049"),
        ('{"command":"arm","lease_s":86401}', "<= 86400.0 - at `$.lease_s`, not 86401"),
        ('{"command":"gain","joint":"joint","gain":5e-324}', "0, or 0.0001 to 5 rad/s per Nm"),
        ('{"command":"gain","joint":"joint","gain":5.01}', "0, or 0.0001 to 5 rad/s per Nm"),
        ('{"command":"payload","mass":5e-324}', "0.001 to 100 kg; 0 for nothing"),
        ('{"command":"payload","mass":100.1}', "0.001 to 100 kg; 0 for nothing"),
        ('{"command":"payload","mass":1,"com":[0,0,2.1]}', "each within 2 m of the origin"),
    ],
)
def test_a_number_out_of_bounds_is_refused_with_value_and_range(
    on: ServedDaemon, packet: str, allowed: str
) -> None:
    answer = asked(on, packet.encode())
    assert not answer["ok"]
    assert allowed in " ".join([answer["message"], *answer.get("reasons", [])])
    assert "expected {" not in answer["message"]
    assert on.rig.mode is Mode.HOLDING


@pytest.mark.parametrize(
    ("packet", "problem"),
    [
        ('{"command":"arm","gain":1.0}', "unknown field `gain`; arm takes `lease_s`, `detached`,"),
        ('{"command":"stop","rows":null}', "unknown field `rows`; stop takes `on_behalf_of`"),
        ('{"command":"gain","joint":"joint"}', "missing required field `gain`; gain takes `joint`"),
        ('{"gain":1.0}', "missing required field `command`; expected"),
    ],
)
def test_a_field_that_its_command_does_not_take_or_lacks_is_named(
    served: ServedDaemon, packet: str, problem: str
) -> None:
    answer = asked(served, packet.encode())
    assert not answer["ok"]
    assert problem in answer["message"]


def test_every_number_of_a_request_has_bounds_in_the_schema() -> None:
    def numbers(node: Any) -> list[dict[str, Any]]:
        if isinstance(node, list):
            return [found for part in node for found in numbers(part)]
        if not isinstance(node, dict):
            return []
        own = [node] if node.get("type") in ("number", "integer") else []
        return own + [found for part in node.values() for found in numbers(part)]

    found = numbers(msgspec.json.schema(Request))
    assert len(found) == 17
    assert all("minimum" in one and "maximum" in one for one in found), found


def test_the_slowest_motion_has_a_bounded_duration(on: ServedDaemon, client: Client) -> None:
    reply = on.until(lambda: client.go(targets={"joint": 0.0}, speed=0.001))
    assert reply.ok, reply
    assert reply.way.duration_s < 10_000.0
    on.rig.request(Event.STOP)
