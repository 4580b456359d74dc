"""Replay: in batches it finds what it would find State by State."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.writer import Writer

from bench.rigs.lockstep import SINGLE_JOINT, lockstep_rig
from bench.rigs.recorded_arm import LockstepClient, made
from common.errors import LogError
from daemon.modes.table import Event
from daemon.protocol.state import Snapshot, State
from estimator.payload import Payload
from programs.clients import replay as replaying
from programs.clients.log_reader import PROFILE, read_log
from programs.clients.log_writer import CHUNK_BYTES
from programs.clients.recorder import record
from programs.clients.replay import Replay, replay

Messages = list[Snapshot | State]
SECONDS = 3.0


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> Messages:
    """A recording in which the arm is enabled, so that its estimator is reset."""
    path = made(tmp_path_factory.mktemp("made") / "made.mcap", SINGLE_JOINT, SECONDS, seed=1)
    return list(read_log(path))


def written(path: Path, messages: list[Any]) -> Path:
    with path.open("wb") as stream:
        log = Writer(stream, chunk_size=CHUNK_BYTES)
        log.start(profile=PROFILE)
        schema = log.register_schema("any", "jsonschema", b"{}")
        channels = {
            kind: log.register_channel(topic, "json", schema)
            for topic, kind in (("/snapshot", Snapshot), ("/state", State))
        }
        for k, message in enumerate(messages):
            data = msgspec.json.encode(message)
            log.add_message(channels[type(message)], log_time=k, publish_time=k, data=data)
        log.finish()
    return path


def states_before_the_damage(path: Path) -> tuple[int, str]:
    read = 0
    try:
        for message in read_log(path):
            read += isinstance(message, State)
    except LogError as error:
        return read, str(error)
    return read, ""


def changed(state: State, **values: Any) -> State:
    return msgspec.structs.replace(state, **values)


@pytest.fixture(params=[1, 7, 64, 5000])
def _batch(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("programs.clients.log_reader.BATCH", request.param)


@pytest.mark.usefixtures("_batch")
def test_a_whole_recording_is_identical_in_batches_of_any_size(
    messages: Messages, tmp_path: Path
) -> None:
    modes = [message.mode for message in messages if isinstance(message, State)]
    assert {"enabling", "holding", "tracking"} <= set(modes)
    states = len(messages) - 1
    assert replay(written(tmp_path / "a.mcap", messages)) == Replay(states, 0, 1, None, "")


@pytest.mark.usefixtures("_batch")
def test_the_first_difference_is_found_in_batches_of_any_size(
    messages: Messages, tmp_path: Path
) -> None:
    several = list(messages)
    for row in (150, 90, 200):
        state = several[row]
        assert isinstance(state, State)
        several[row] = changed(state, phi=[0.5], threshold=[state.threshold[0] + 1e-12])
    result = replay(written(tmp_path / "a.mcap", several))
    first = messages[90]
    assert isinstance(first, State)
    assert result.states == len(messages) - 1
    assert not result.identical
    assert result.difference is not None
    found = result.difference
    assert (found.tick, found.field, found.recorded) == (first.tick, "phi", [0.5])
    assert found.replayed == first.phi


@pytest.mark.usefixtures("_batch")
def test_after_a_gap_it_waits_for_a_snapshot_in_batches_of_any_size(
    messages: Messages, tmp_path: Path
) -> None:
    snapshot, states = messages[0], messages[1:]
    # Snapshots belong to the tick before their first State: of the beginning alone is one here.
    gapped = [snapshot, *states[:100], *states[103:150], snapshot, *states[:20]]
    result = replay(written(tmp_path / "a.mcap", gapped))
    assert result == Replay(120, 47, 2, None, "")


@pytest.mark.usefixtures("_batch")
def test_late_states_do_not_end_a_gap(messages: Messages, tmp_path: Path) -> None:
    snapshot, states = messages[0], messages[1:]
    disordered = [snapshot, *states[:100], *states[103:110], *states[100:103], *states[110:120]]
    assert replay(written(tmp_path / "a.mcap", disordered)) == Replay(100, 20, 1, None, "")


@pytest.mark.usefixtures("_batch")
def test_the_reset_when_the_arm_begins_to_hold_is_replayed(
    messages: Messages, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if it were forgotten: the residual is another."""
    monkeypatch.setattr(replaying, "resets", lambda mode, states: frozenset())
    result = replay(written(tmp_path / "a.mcap", messages))
    assert result.difference is not None
    assert result.difference.field == "residual"


@pytest.mark.parametrize("end", [0.3, 0.7, 0.9])
@pytest.mark.usefixtures("_batch")
def test_the_whole_part_of_a_broken_file_is_compared(
    messages: Messages, tmp_path: Path, end: float
) -> None:
    path = written(tmp_path / "a.mcap", messages)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(end * len(whole))])
    read, why = states_before_the_damage(path)
    assert 0 < read < len(messages) - 1
    assert replay(path) == Replay(read, 0, 1, None, why)


def test_a_snapshot_for_another_number_of_joints_is_damaged(
    messages: Messages, tmp_path: Path
) -> None:
    plain = json.loads(msgspec.json.encode(messages[0]))
    plain["joints"] = ["one", "two"]
    doubled = msgspec.convert(plain, Snapshot)
    path = written(tmp_path / "a.mcap", [doubled, *_of_two_joints(messages[1:10])])
    with pytest.raises(LogError, match="2 joints, 1 in its configuration"):
        replay(path)


def _of_two_joints(messages: Messages) -> list[State]:
    def twice(value: object) -> object:
        return [*value, *value] if isinstance(value, list) and len(value) == 1 else value

    change: Callable[[State], State] = lambda state: changed(  # noqa: E731
        state, **{name: twice(getattr(state, name)) for name in state.__struct_fields__}
    )
    return [change(message) for message in messages if isinstance(message, State)]


@pytest.mark.usefixtures("_batch")
def test_a_payload_set_taken_off_and_recorded_from_the_middle_on_is_replayed(
    tmp_path: Path,
) -> None:
    """Also by a recording that begins while one is carried."""
    cup, jug = (Payload(mass=m, com=[0.02, 0.01, -0.3]) for m in (0.2, 0.9))
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.enable()
        rig.request(Event.START)
        rig.tick.carry(jug, "the test")
        rig.run(0.5)
        asked: list[tuple[int, Payload | None]] = [
            (5, cup), (6, None), (70, jug), (71, jug), (150, None), (151, cup),
        ]  # fmt: skip
        begun = rig.ticks

        def stop() -> bool:
            while asked and rig.ticks - begun >= asked[0][0]:
                assert not rig.tick.carry(asked.pop(0)[1], "the test")
            return rig.ticks - begun >= 250

        path = tmp_path / "carried.mcap"
        record(lambda: LockstepClient(rig), path, stop=stop)  # type: ignore[arg-type, return-value]
    result = replay(path)
    assert (result.identical, result.states) == (True, 250)
    messages = list(read_log(path))
    forgotten = [
        changed(m, payload=None) if isinstance(m, State) and m.tick > begun + 160 else m
        for m in messages
    ]
    assert not replay(written(tmp_path / "other.mcap", forgotten)).identical
