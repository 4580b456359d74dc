"""Stops through the daemon's socket: done only when every joint was seen to stand, in lockstep."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.rigs.faulty_wire import FaultyWire
from bench.rigs.lockstep import ROMEO
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.faults.conditions import Condition
from daemon.faults.symptoms import advice_of
from daemon.modes.table import Event, Mode
from daemon.protocol.replies import Reply
from daemon.protocol.requests import GetStatus, bare
from daemon.protocol.socket_path import Peer
from drivers.can.wire import Wire
from drivers.canopen.codec import transmit_pdos
from drivers.canopen.ids import SDO_ANSWER
from drivers.drive import Drive
from programs.contactctl import replies

PEER = Peer(0, 1, 1)
JOINT = 2


@pytest.fixture
def wires() -> list[FaultyWire]:
    return []


@pytest.fixture
def romeo(tmp_path: Path, wires: list[FaultyWire]) -> Iterator[ServedDaemon]:
    def between(wire: Wire) -> FaultyWire:
        wires.append(FaultyWire(wire))
        return wires[0]

    with served_daemon(tmp_path, ROMEO, between=between) as served:
        served.rig.enable()
        yield served


def drive_of(served: ServedDaemon) -> Drive:
    return served.rig.robot.configuration.joint_drives[JOINT]


def unheard(drive: Drive) -> set[int]:
    """Everything that would say that it stands."""
    return {pdo.cob_id for pdo in transmit_pdos(drive)} | {SDO_ANSWER + drive.node}


def asked(served: ServedDaemon, command: str) -> Reply:
    return served.service.commands.handle(bare(command), PEER)


def test_the_reply_to_a_stop_names_joints_without_proof_of_standstill(
    romeo: ServedDaemon, wires: list[FaultyWire]
) -> None:
    assert asked(romeo, "stop").unproved == []  # it holds: no drive is commanded to stop
    romeo.run(0.1)
    reply = asked(romeo, "disable")
    names = list(romeo.rig.tick.drives.names)
    assert (reply.mode, reply.unproved) == (Mode.OFF, names), "none is commanded yet"
    assert romeo.service.commands.handle(GetStatus(), PEER).status.unproved == names
    romeo.run(0.5)
    assert asked(romeo, "stop").unproved == []
    romeo.rig.enable()
    wires[0].lost |= unheard(drive_of(romeo))
    romeo.run(0.1)
    for command in ("stop", "disarm"):
        reply = asked(romeo, command)
        assert (reply.ok, reply.mode) == (True, Mode.FAULTED)
        assert reply.unproved == [names[JOINT]]


def test_contactctl_reports_a_stop_without_proof_as_an_error(
    romeo: ServedDaemon, wires: list[FaultyWire], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replies, "WAIT_S", 0.3)
    name = romeo.rig.tick.drives.names[JOINT]
    wires[0].lost |= unheard(drive_of(romeo))
    romeo.run(1.0)
    assert romeo.rig.tick.drives.silenced
    result = romeo.contactctl("stop")
    assert (result.exit_code, result.stdout) == (1, "")
    first, cause, silent = result.stderr.splitlines()
    assert f"not seen to stand: {name}; press the emergency stop" in first
    assert cause.startswith("  - faulted: samples stale")
    assert "contactd sends nothing to the drives until `reset`" in silent
    status = json.loads(romeo.contactctl("--json", "status").stdout)
    assert (status["unproved"], status["silenced"]) == ([name], True)
    wires[0].lost.clear()
    romeo.run(0.2)  # it is still asked, and answers
    assert romeo.contactctl("stop").exit_code == 0
    assert romeo.contactctl("reset").exit_code == 0
    assert romeo.rig.mode is Mode.OFF


def test_the_advice_is_on_the_first_cause_and_on_a_missing_proof(
    romeo: ServedDaemon, wires: list[FaultyWire]
) -> None:
    def advice() -> list[str]:
        return asked(romeo, "status").status.advice.splitlines()

    stale, doubted, lost = (
        advice_of(condition)
        for condition in (Condition.STALE, Condition.NOT_SEEN_TO_STOP, Condition.UNPROVED)
    )
    assert advice() == []
    wires[0].lost |= unheard(drive_of(romeo))
    romeo.run(0.06)
    assert advice() == [doubted, stale]
    found = set()
    for _ in range(100):
        romeo.tick()
        found |= {finding.condition for finding in romeo.rig.last.findings}
    assert romeo.rig.tick.drives.silenced
    assert found > {Condition.STALE, Condition.UNPROVED}, "more than the cause was found"
    assert advice() == [lost, stale]
    wires[0].lost.clear()
    romeo.run(0.2)
    assert advice() == [stale]
    assert not romeo.service.commands.set_up.request(Event.RESET, "a person")
    romeo.run(0.1)
    assert advice() == []
