"""Recorded frames of an arm of motors: they give the samples that the daemon had."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import BEAM, OPENARM, lockstep_rig
from daemon.modes.table import Event
from daemon.protocol.state import State
from daemon.service.black_box_log import context_of_log, context_path, save
from daemon.service.status import context_of
from drivers.can.frame_ring import FrameRing, RecordedWire
from programs.recordings.recomputed import recomputed

SECONDS = 1.5


@pytest.mark.parametrize("arm", [OPENARM, BEAM])
def test_the_samples_are_those_of_the_daemon(tmp_path: Path, arm: Path) -> None:
    now, states = [0.0], list[State]()
    ring = FrameRing(tmp_path / "control.frames", 40_000, lambda: now[0])
    with lockstep_rig(arm, between=lambda wire: RecordedWire(wire, ring)) as rig:

        def each() -> None:
            now[0] = rig.time_s
            states.append(rig.state())

        rig.enable()
        rig.request(Event.START)
        rig.run(SECONDS, each)
        context_path(tmp_path / "control.frames").write_bytes(
            msgspec.json.encode(context_of(rig.robot))
        )
    log = save(tmp_path / "control.frames", tmp_path / "state", [])
    ring.close()
    assert log is not None
    snapshot, found = recomputed(log, context_of_log(log))
    assert len(snapshot.joints) == len(rig.robot.configuration.joints)
    pairs = list(zip(found[::-1], states[::-1], strict=False))[
        :-1
    ]  # the first came before its time
    assert len(pairs) == SECONDS * 100 - 1
    for name in ("current", "link_position", "motor_velocity", "motor_position", "fresh"):
        assert [getattr(a, name) for a, _ in pairs] == [getattr(b, name) for _, b in pairs]
    moved = np.ptp([a.link_position for a, _ in pairs], axis=0)
    assert moved.max() == pytest.approx(0.2, abs=0.2)
