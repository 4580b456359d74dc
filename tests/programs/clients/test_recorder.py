"""Recordings: they are read as written, and damage is reported."""

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from common.errors import ControlError, LogError, UnreachableError
from daemon.protocol.state import STATE_FORMAT, Contact, Notice, Snapshot, State
from programs.clients.client import Client
from programs.clients.log_reader import read_log
from programs.clients.log_writer import CHUNK_BYTES
from programs.clients.recorder import record
from programs.clients.replay import SAME_ESTIMATOR, replay
from programs.clients.trajectory_recorder import record_trajectory
from programs.clients.viewer_schema import viewer_schema
from tests.examples import scaled
from tests.fake_daemon import state_at

FORMATS = {version: Path(__file__).with_name(f"format_{version}.mcap") for version in range(1, 8)}
"""Some ticks of configs/single_joint in lockstep, recorded by a contactd of that format, of 4 by
the last that did not write `level_share`. In 2 the joint is pushed. They never change."""


@pytest.fixture
def connect(fake_daemon: Any) -> Callable[[], Client]:
    return lambda: Client(fake_daemon.path, timeout_s=0.5)


@pytest.fixture
def recording(connect: Callable[[], Client], tmp_path: Path) -> Path:
    """About a hundred states."""
    record(connect, tmp_path / "made.mcap", seconds=1.0)
    return tmp_path / "made.mcap"


def test_round_trip(connect: Callable[[], Client], tmp_path: Path) -> None:
    path = tmp_path / "made.mcap"
    made = record(connect, path, seconds=1.0)
    snapshot, *states = read_log(path)
    assert isinstance(snapshot, Snapshot)
    assert states == [state_at(snapshot.tick + 1 + i) for i in range(len(states))]
    assert made.states == len(states) == 101  # both ends of a second
    assert made.duration_s == pytest.approx(1.0)
    assert (made.lost, made.snapshots, made.ended) == (0, 1, "")


def test_messages_are_verbatim_and_stamped_with_the_time_of_their_tick(recording: Path) -> None:
    with recording.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            assert message.publish_time == message.log_time
            if channel.topic == "/state":
                tick = json.loads(message.data)["tick"]
                assert message.data == msgspec.json.encode(state_at(tick))
                wall_s = state_at(tick).timing.wall_s
                assert message.log_time == round(wall_s * 1e9)
        stream.seek(0)
        statistics = make_reader(stream).get_summary()
    assert statistics is not None
    assert all(index.compression == "zstd" for index in statistics.chunk_indexes)


def test_stop_ends_the_recording(connect: Callable[[], Client], tmp_path: Path) -> None:
    asked: list[int] = []

    def stop() -> bool:
        asked.append(1)
        return len(asked) > 20

    made = record(connect, tmp_path / "made.mcap", stop=stop)
    assert (made.states, made.ended) == (20, "")
    assert len(list(read_log(tmp_path / "made.mcap"))) == 21


def test_a_gap_is_followed_by_a_new_snapshot(
    fake_daemon: Any, connect: Callable[[], Client], tmp_path: Path
) -> None:
    start = fake_daemon.tick + 100
    fake_daemon.states = lambda tick: None if start < tick <= start + 5 else state_at(tick)
    made = record(connect, tmp_path / "made.mcap", seconds=2.0)
    messages = list(read_log(tmp_path / "made.mcap"))
    places = [i for i, message in enumerate(messages) if isinstance(message, Snapshot)]
    assert made.snapshots == len(places) == 2
    assert made.lost >= 5
    before, again, after = messages[places[1] - 1 : places[1] + 2]
    assert isinstance(before, State)
    assert before.tick == start
    assert isinstance(again, Snapshot)
    assert isinstance(after, State)
    assert after.tick == again.tick + 1
    assert made.lost == after.tick - start - 1
    assert made.states == len(messages) - 2


def test_states_before_the_snapshot_are_left_out(
    fake_daemon: Any, connect: Callable[[], Client], tmp_path: Path
) -> None:
    fake_daemon.snapshot_ahead = 5
    made = record(connect, tmp_path / "made.mcap", seconds=0.1)
    snapshot, first, *_ = read_log(tmp_path / "made.mcap")
    assert isinstance(first, State)
    assert first.tick == snapshot.tick + 1
    assert (made.lost, made.snapshots) == (0, 1)


def test_a_daemon_that_ends_leaves_a_whole_file(
    fake_daemon: Any, connect: Callable[[], Client], tmp_path: Path
) -> None:
    timer = threading.Timer(0.2, fake_daemon.stopped.set)
    timer.start()
    made = record(connect, tmp_path / "made.mcap")
    timer.join()
    assert "closed the connection" in made.ended
    assert len(list(read_log(tmp_path / "made.mcap"))) == made.states + 1 > 1


def test_a_daemon_that_falls_silent_leaves_a_whole_file(
    fake_daemon: Any, connect: Callable[[], Client], tmp_path: Path
) -> None:
    end = fake_daemon.tick + 200
    fake_daemon.states = lambda tick: state_at(tick) if tick < end else None
    made = record(connect, tmp_path / "made.mcap")
    assert made.ended == "the daemon fell silent"
    assert list(read_log(tmp_path / "made.mcap"))[-1].tick == end - 1


def test_a_file_is_never_overwritten(connect: Callable[[], Client], tmp_path: Path) -> None:
    path = tmp_path / "precious.mcap"
    path.write_text("precious")
    with pytest.raises(LogError, match="never overwritten"):
        record(connect, path)
    assert path.read_text() == "precious"


@pytest.mark.parametrize("make", [record, record_trajectory])
def test_a_folder_without_access_is_reported(make: Callable[..., Any]) -> None:
    class Closed(type(Path())):  # type: ignore[misc]
        def lstat(self) -> Any:  # as it is for users other than root
            raise PermissionError(13, "Permission denied", str(self))

    def connect() -> Client:
        raise AssertionError("refused before")

    with pytest.raises(LogError) as caught:
        make(connect, Closed("/closed/made"))
    assert str(caught.value) == "cannot write /closed/made: Permission denied"


def test_no_daemon_makes_no_file(tmp_path: Path) -> None:
    with pytest.raises(UnreachableError):
        record(lambda: Client(tmp_path / "nothing"), tmp_path / "made.mcap")
    assert not (tmp_path / "made.mcap").exists()


def test_refused_subscription_makes_no_file(
    fake_daemon: Any, connect: Callable[[], Client], tmp_path: Path
) -> None:
    fake_daemon.refusals["subscribe"] = ["not now"]
    with pytest.raises(ControlError, match="not now"):
        record(connect, tmp_path / "made.mcap")
    assert not (tmp_path / "made.mcap").exists()


@pytest.mark.parametrize("path", ["/nonexistent/made.mcap", "/proc/made.mcap"])
def test_a_path_that_cannot_be_written_is_refused(connect: Callable[[], Client], path: str) -> None:
    with pytest.raises(LogError, match=f"cannot write {path}"):
        record(connect, Path(path))


def test_a_full_disk_is_reported(connect: Callable[[], Client]) -> None:
    class Full(type(Path())):  # type: ignore[misc]
        def lstat(self) -> Any:
            raise FileNotFoundError

        def open(self, mode: str) -> Any:
            assert mode == "xb"
            return Path("/dev/full").open("wb", buffering=0)

    with pytest.raises(LogError, match="No space left"):
        record(connect, Full("/dev/full"), seconds=0.1)


def nodes(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield schema
    for child in schema.get("properties", {}).values():
        yield from nodes(child)
    if "items" in schema:
        yield from nodes(schema["items"])


@pytest.mark.parametrize("kind", [State, Snapshot, Notice, Contact])
def test_schema_is_as_plain_as_viewers_need(kind: type) -> None:
    schema = viewer_schema(kind)
    assert "$ref" not in json.dumps(schema)
    assert "anyOf" not in json.dumps(schema)
    assert list(schema["properties"]) == list(kind.__struct_fields__)  # type: ignore[attr-defined]
    for node in nodes(schema):
        assert node["type"] in {"object", "array", "string", "number", "integer", "boolean"}
        assert ("properties" in node) == (node["type"] == "object")
        assert ("items" in node) == (node["type"] == "array")


def test_schema_describes_nested_and_optional_fields() -> None:
    fields = viewer_schema(State)["properties"]
    assert fields["motor_position"]["items"] == {"type": "number"}
    assert fields["timing"]["properties"]["wall_s"] == {"type": "number"}
    contact = fields["notices"]["items"]["properties"]["contact"]
    assert contact["properties"]["level"]["enum"] == ["collision", "contact"]


def broken(path: Path) -> tuple[list[Snapshot | State], str]:
    """Contents that can be read, and what is said about the rest."""
    found: list[Snapshot | State] = []
    try:
        for message in read_log(path):
            found.append(message)  # noqa: PERF402 - what came before the error counts
    except LogError as error:
        return found, str(error)
    return found, ""


def test_a_truncated_file_yields_its_whole_chunks(
    connect: Callable[[], Client], tmp_path: Path
) -> None:
    path = tmp_path / "made.mcap"
    record(connect, path, seconds=5.0)  # several chunks
    whole = list(read_log(path))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])
    found, said = broken(path)
    assert 50 < len(found) < len(whole)
    assert found == whole[: len(found)]
    last = found[-1].tick
    assert f"ends in the middle: {len(found) - 1} states read, last tick {last}" in said


def test_a_killed_recorder_loses_less_than_a_second(
    connect: Callable[[], Client], tmp_path: Path
) -> None:
    """Contents of the file while it is still being written."""
    path, cut = tmp_path / "made.mcap", tmp_path / "cut.mcap"
    asked = 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        if asked == 200:
            cut.write_bytes(path.read_bytes())
        return asked > 200

    record(connect, path, stop=stop)
    found, said = broken(cut)
    assert "ends in the middle" in said
    states = [message for message in found if isinstance(message, State)]
    chunk = CHUNK_BYTES / len(msgspec.json.encode(states[0]))
    assert 199 - chunk - 2 <= len(states) < 199
    assert chunk < 100  # a second


@settings(max_examples=scaled(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_file_cut_anywhere_yields_a_beginning_and_an_error(
    recording: Path, tmp_path: Path, share: float
) -> None:
    whole = list(read_log(recording))
    data = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(share * len(data))])
    found, said = broken(cut)
    assert said
    assert found == whole[: len(found)]


@settings(max_examples=scaled(100), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@example(share=0.0001289244879497785, bit=2)  # a message of a channel that there is not
def test_a_flipped_bit_never_changes_the_states_read(
    recording: Path, tmp_path: Path, share: float, bit: int
) -> None:
    whole = list(read_log(recording))
    data = bytearray(recording.read_bytes())
    data[int(share * len(data))] ^= 1 << bit
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    found, _ = broken(damaged)
    assert found == whole[: len(found)]


@pytest.mark.parametrize("content", [b"", b"\x89MC", b"hello" * 100, bytes(1000)])
def test_a_file_of_another_kind_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    said = "is not an MCAP file" if content else "is empty"
    assert broken(path) == ([], f"{path} {said}")


@pytest.mark.parametrize(
    ("profile", "topic", "message", "said"),
    [
        ("ros2", "", {}, "is an MCAP file, but not a recording of contactd"),
        ("contactd", "/state", {"tick": 3}, "another version after tick none"),
        # Refused by its version, before anything else of it is read.
        ("contactd", "/snapshot", {"joints": ["a"]},
         "{} is a recording of a contactd before format 1, whose States have other fields: record"),
        ("contactd", "/snapshot", {"format": 0}, "{} is a recording of a contactd before format 1"),
        ("contactd", "/snapshot", {"format": STATE_FORMAT + 1},
         f"{{}} is a recording of format {STATE_FORMAT + 1}; this contactd reads up to"),
    ],
    ids=["ROS", "other State", "no format", "format 0", "later format"],
)  # fmt: skip
def test_recordings_of_other_programs_and_formats_are_refused(
    tmp_path: Path, profile: str, topic: str, message: dict[str, Any], said: str
) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile=profile)
        if topic:
            schema = writer.register_schema("x", "jsonschema", b'{"type": "object"}')
            channel = writer.register_channel(topic, "json", schema)
            writer.add_message(channel, 0, json.dumps(message).encode(), 0)
        writer.finish()
    kept, error = broken(path)
    assert kept == []
    assert said.format(path) in error


@pytest.mark.parametrize(
    ("version", "states"), [(1, 20), (2, 50), *((version, 90) for version in range(3, 8))]
)
def test_a_recording_of_each_format_is_read(version: int, states: int) -> None:
    snapshot, *found = read_log(FORMATS[version])
    assert isinstance(snapshot, Snapshot)
    assert (snapshot.format, len(found)) == (version, states)
    first = snapshot.tick + 1
    assert [message.tick for message in found] == list(range(first, first + states))
    assert version != 2 or any(state.thresholded[0] for state in found)


def test_every_format_has_its_recording() -> None:
    assert list(FORMATS) == list(range(1, STATE_FORMAT + 1))


@pytest.mark.parametrize("version", FORMATS)
def test_only_recordings_of_the_present_estimator_are_replayed(version: int) -> None:
    found = replay(FORMATS[version])
    if version >= SAME_ESTIMATOR:
        assert (found.identical, found.older) == (True, "")
    else:
        assert (found.identical, found.states) == (False, 0)
        assert "was a different one: replay it with that version" in found.older


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    assert "cannot read" in broken(tmp_path / "nothing")[1]
