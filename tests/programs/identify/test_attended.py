"""Motions of a live step: they halt where they are not attended or nothing is recorded, and other
steps leave them alone; in lockstep."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.rigs.served_daemon import ServedDaemon
from common.errors import LogError
from daemon.modes.table import Mode
from programs.clients import recorder
from programs.clients.client import Client
from programs.identify import session
from tests.programs.identify.typed_session import TypedCommand, wired_joint

FRICTION = ("friction", "--seconds", "20", "--yes")


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedDaemon]:
    """Off."""
    with wired_joint(tmp_path).served() as served:
        yield served


def test_it_halts_with_the_client_that_started_it(served: ServedDaemon) -> None:
    served.rig.enable()
    with Client(served.path) as client:
        here = float(served.rig.samples.link_position[0])
        served.until(lambda: client.load_trajectory(["joint"], [0.0, 20.0], [[here], [here + 0.3]]))
        assert served.until(lambda: client.start_loaded(attended=True)).ok
        served.run(1.0)
        assert served.rig.mode is Mode.TRACKING
    served.run(0.3)
    assert served.rig.mode is Mode.HOLDING


@pytest.mark.parametrize("attends", [True, False])
def test_a_step_attends_its_motion(
    served: ServedDaemon, monkeypatch: pytest.MonkeyPatch, attends: bool
) -> None:
    served.service.commands.attendance.silent_s = 2.0
    if not attends:  # as one that was stopped by Ctrl-Z
        monkeypatch.setattr(session, "_ATTENDS_EVERY_S", math.inf)
    status, said = TypedCommand(served, *FRICTION).ends()
    assert (status == 0) is attends, said
    silent = "abandon by the daemon: its client has been silent for 2 s"
    assert (silent in " ".join(said.split())) is not attends


def test_another_step_is_refused_meanwhile_and_disturbs_nothing(served: ServedDaemon) -> None:
    first = TypedCommand(served, *FRICTION)
    first.moves(1.0)
    second = served.contactd("identify", "wiring", "--yes")
    assert second.exit_code == 1
    said = " ".join(second.output.split())
    assert "the arm runs identify friction, started elsewhere: `contactctl pause`" in said
    assert first.ends()[0] == 0


def test_it_ends_as_soon_as_nothing_is_recorded(
    served: ServedDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = TypedCommand(served, *FRICTION)

    def full(connect: object, path: Path, *, stop: Any) -> None:
        path.touch()
        while first.ticks_in_motion < 100 and not stop():
            pass
        raise LogError(f"cannot write {path}: No space left on device")

    monkeypatch.setattr(recorder, "record", full)
    status, said = first.ends()
    assert status != 0
    assert "No space left on device" in said
    assert first.ticks_in_motion < 500
    assert served.rig.mode is Mode.HOLDING
    folder = served.service.process.robot.path.parent / "identify"
    assert not list(folder.glob("*.mcap"))


def test_a_daemon_that_is_killed_leaves_a_step_that_did_not_finish(served: ServedDaemon) -> None:
    first = TypedCommand(served, *FRICTION)
    first.moves(1.0)
    served.path.unlink()
    served.service.control.drop_all()
    status, said = first.ends()
    assert status == 1
    assert "friction did not finish: the daemon closed the connection. What was measured is" in said
    folder = served.service.process.robot.path.parent / "identify"
    assert [path.name for path in folder.glob("*.mcap")] == ["friction.part01.mcap"]


def test_ctrl_c_in_the_moment_of_the_start_halts_it(
    served: ServedDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = Client.start_loaded

    def interrupted(self: Client, *, attended: bool) -> None:
        start(self, attended=attended)
        raise KeyboardInterrupt

    monkeypatch.setattr(Client, "start_loaded", interrupted)
    assert "stopped by you; the arm is holding" in TypedCommand(served, *FRICTION).ends()[1]
    assert served.rig.mode is Mode.HOLDING
