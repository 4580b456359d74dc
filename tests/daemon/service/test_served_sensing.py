"""Joints that sense contact, and their smallest touch, in the daemon's status."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from bench.rigs.faulty_wire import FaultyWire
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.config.schema import Configuration
from daemon.service.sensitivity import sensitivity_now
from drivers.can.wire import Wire
from drivers.canopen.codec import transmit_pdos


def patient(c: Configuration) -> Configuration:
    """Missing samples alone are no fault; their joint senses nothing."""
    supervisor = msgspec.structs.replace(c.supervisor, stale_ticks=200)
    return msgspec.structs.replace(c, supervisor=supervisor)


@pytest.mark.parametrize(("learning", "least"), [(True, 0.2), (False, 1.0)])
def test_the_least_level_without_learning(tmp_path: Path, learning: bool, least: float) -> None:
    def learns(c: Configuration) -> Configuration:
        estimator = msgspec.structs.replace(c.estimator, learning=learning)
        return msgspec.structs.replace(c, estimator=estimator)

    with served_daemon(tmp_path, configure=learns) as served:
        status = json.loads(served.contactctl("--json", "status").stdout)
    assert status["least"] == [pytest.approx(least * status["contact"][0])]


@contextmanager
def served_wire(folder: Path) -> Iterator[tuple[ServedDaemon, list[FaultyWire]]]:
    wires: list[FaultyWire] = []

    def between(wire: Wire) -> FaultyWire:
        wires.append(FaultyWire(wire))
        return wires[0]

    with served_daemon(folder, configure=patient, between=between) as served:
        yield served, wires


def test_status_names_a_joint_that_does_not_sense_and_since_when(tmp_path: Path) -> None:
    with served_wire(tmp_path) as (served, wires):
        served.rig.enable()
        shown = served.contactctl("status").stdout
        assert "sensing       every joint, for 0:00:0" in shown
        assert "not sensing" not in shown
        (drive,) = served.rig.robot.configuration.joint_drives
        wires[0].lost = {pdo.cob_id for pdo in transmit_pdos(drive)}
        lost_s = served.rig.time_s
        served.run(0.4)
        status = json.loads(served.contactctl("--json", "status").stdout)
        shown = served.contactctl("status").stdout
        state = served.rig.state()
        wires[0].lost = set()
        served.run(0.4)
        assert "not sensing" not in served.contactctl("status").stdout
    assert (status["sensing"], state.sensing) == ([False], [False])
    assert status["sensing_since_s"] == state.sensing_since_s
    assert 0.015 < state.sensing_since_s[0] - lost_s < 0.035  # two periods and a half, of 10 ms
    assert "not sensing contact: joint for 0." in shown
    assert "every joint" not in shown
    assert "joint             nothing    nothing" in shown


def test_a_level_that_fades_after_missing_samples_is_reported(tmp_path: Path) -> None:
    with served_wire(tmp_path) as (served, wires):
        served.rig.enable()
        served.run(0.3)
        before = sensitivity_now(served.rig.tick)
        (drive,) = served.rig.robot.configuration.joint_drives
        wires[0].lost = {pdo.cob_id for pdo in transmit_pdos(drive)}
        served.run(0.03)
        wires[0].lost = set()
        served.run(0.02)
        after = sensitivity_now(served.rig.tick)
        assert before is not None
        assert after is not None
        (level,) = served.rig.estimate.threshold.tolist()
        assert after.resting == [pytest.approx(level, rel=0.02)]
        (resting,), (moving,) = before.resting, before.moving
        assert resting is not None
        assert level > 1.2 * resting
        # By as much in motion.
        assert after.moving == [pytest.approx(moving + level - resting, rel=0.02)]
