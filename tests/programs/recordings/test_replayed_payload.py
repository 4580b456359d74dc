"""Payloads in replays with other settings: as recorded, unless something else is asked."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import SINGLE_JOINT, lockstep_rig
from common.arrays import Matrix
from common.errors import ConfigurationError
from daemon.modes.table import Event
from daemon.protocol.state import Snapshot, State
from daemon.service.status import snapshot_of
from estimator.model import Model
from estimator.payload import Payload
from programs.clients.log_reader import read_log
from programs.recordings.replayed import ReplayedRows
from programs.recordings.replayed_payload import ReplayedPayload
from programs.recordings.settings import Change, changed_configuration
from tests.programs.clients.test_replay import written

SAME: Change = ("estimator.debounce", "1")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A joint, given a cup by its name, in the middle, that it does not carry."""
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.run(0.1)
        rig.request(Event.ENABLE)
        rig.run(0.9)
        rig.request(Event.START)
        snapshot = snapshot_of(rig.robot, rig.tick)
        text = snapshot.configuration + "payloads:\n  cup: {mass: 3.0}\n"
        snapshot = msgspec.structs.replace(snapshot, configuration=text)
        model = Model(rig.robot.urdf, rig.robot.configuration.joint_names)
        cup = Payload.of(3.0, model.tool_place.tolist(), "cup")
        messages: list[Snapshot | State] = [snapshot, *rig.states(0.5)]
        assert rig.tick.carry(cup, "me") == []
        messages += rig.states(2.0)
    return written(tmp_path_factory.mktemp("carried") / "cup.mcap", messages)


def residuals(path: Path, *changes: Change) -> Matrix:
    return np.vstack([rows.residual for rows in ReplayedRows(path, changes, fresh=False).parts()])


def recorded(path: Path) -> Matrix:
    return np.array([state.residual for state in read_log(path) if isinstance(state, State)])


def test_a_payload_set_while_recording_is_replayed(recording: Path) -> None:
    np.testing.assert_array_equal(residuals(recording, SAME), recorded(recording))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("payload", "cup"), ("payload", "3.0")),
        (("payload", "none"), ("payloads.cup.mass", "1e-12")),
        (("payload", "{mass: 3.0}"), ("payload", "cup")),
    ],
)
def test_other_payloads_are_counted(recording: Path, first: Change, second: Change) -> None:
    one, other = residuals(recording, first), residuals(recording, second)
    np.testing.assert_allclose(one, other, atol=1e-9)
    assert np.max(np.abs(one - recorded(recording))) > 0.02  # [Nm]


def test_an_unannounced_load_stops_learning_unless_it_is_set_here() -> None:
    class Fake:
        frozen = False

        def carry(self, payload: Payload | None) -> None:
            """Nothing to see."""

        def freeze_learning(self, frozen: bool) -> None:
            self.frozen = frozen

    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.run(0.1)
        c = rig.robot.configuration
        model = Model(rig.robot.urdf, c.joint_names)
        state = rig.state()
    load = msgspec.structs.replace(state, recognised=Payload.of(0.3, (0.0, 0.0, 0.0)))
    for changes, frozen in (((SAME,), True), ((("payload", "0.3"),), False)):
        estimator = Fake()
        carried = ReplayedPayload(changes, c, model)
        carried.apply(estimator, load)  # type: ignore[arg-type]
        assert estimator.frozen is frozen
        carried.apply(estimator, state)  # type: ignore[arg-type]
        assert not estimator.frozen


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("plate", "there are: cup"),
        ("-1", "Expected `float` > 0.0"),
        ("1e9", "Expected `float` <= 100.0"),
        ("nan", "there is no such name"),
        (".nan", "must be none, a mass"),
        ("[0.3]", "must be none, a mass"),
        ("{mass: 0.3, place: 1}", "unknown field `place`"),
        ("{mass: 0.3, com: [9, 0, 0]}", "com"),
        ("{", "is not valid YAML"),
    ],
)
def test_invalid_payloads_are_refused(recording: Path, value: str, said: str) -> None:
    snapshot = next(iter(read_log(recording)))
    assert isinstance(snapshot, Snapshot)
    c = changed_configuration(snapshot, [("payload", value)])
    with pytest.raises(ConfigurationError, match=r"^--set payload=") as caught:
        ReplayedPayload([("payload", value)], c, Model(snapshot.urdf, c.joint_names))
    assert said in str(caught.value)
