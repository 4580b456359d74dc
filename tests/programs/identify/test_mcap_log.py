"""Logs of other programs in MCAP: JSON, protobuf and ROS 2's JointState are read as a CSV is."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from mcap.writer import Writer
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer

from bench.rigs.foreign_logs import Stranger, Style, stranger, urdf_of, write_csv
from common.errors import LogError
from identification.motion_log import MotionLog
from programs.contactd.contactd import main
from programs.identify import mcap_log
from programs.identify.csv_log import read_csv

JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
BEGUN_S = 1_780_000_000
LATE_NS = 7_000_000
"""between a stamp and its log time, of every other message"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    return stranger(2, 20.0, tmp_path_factory.mktemp("stranger"))


@pytest.fixture
def as_csv(tmp_path: Path, arm: Stranger) -> MotionLog:
    path = write_csv(arm, Style(without=("motor_pos",)), tmp_path / "as.csv")
    names = arm.log.joints
    lines = ["joints:"] + [
        f"  {name}: {{link_position: {{column: {name}_pos_rad}}, motor_velocity: {{column: "
        f"{name}_vel}}, current: {{column: {name}_cur}}}}"
        for name in names
    ]
    path.with_suffix(".yaml").write_text("\n".join(["time: {column: timestamp}", *lines]))
    return read_csv(path, names, {})[0]


def stamps(log: MotionLog) -> list[tuple[int, int, int]]:
    """Seconds, nanoseconds, and log time [ns] of each sample."""
    whole = [divmod(round(t * 1e9), 10**9) for t in log.time_s]
    return [(BEGUN_S + s, ns, (BEGUN_S + s) * 10**9 + ns + LATE_NS * (k % 2))
            for k, (s, ns) in enumerate(whole)]  # fmt: skip


def message(log: MotionLog, k: int, order: list[int]) -> dict[str, list[object]]:
    """Fields of a JointState, its joints in an order of its own."""
    rows = {"position": log.link_position, "velocity": log.motor_velocity, "effort": log.current}
    named: list[object] = [log.joints[i] for i in order]
    return {"name": named} | {key: values[k][order].tolist() for key, values in rows.items()}


def orders(log: MotionLog) -> Callable[[int], list[int]]:
    return lambda k: list(range(log.n)) if k % 3 else list(range(log.n))[::-1]


def in_json(path: Path, log: MotionLog) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/joint_states", "json", 0)
        for k, (sec, nanosec, at) in enumerate(stamps(log)):
            header = {"stamp": {"sec": sec, "nanosec": nanosec}}
            text = json.dumps({"header": header, **message(log, k, orders(log)(k))})
            writer.add_message(channel, at, text.encode(), at)
        writer.finish()


def in_ros2(path: Path, log: MotionLog) -> None:
    """With a gripper on the same topic, which begins."""
    with path.open("wb") as stream:
        writer = Ros2Writer(stream)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for k, (sec, nanosec, at) in enumerate(stamps(log)):
            header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}
            fingers = {"name": ["finger"], "position": [0.1], "velocity": [0.0], "effort": [0.0]}
            for content in (fingers, message(log, k, orders(log)(k))):
                writer.write_message("/joint_states", schema, {"header": header, **content}, at)
        writer.finish()


def in_protobuf(path: Path, log: MotionLog) -> None:
    with path.open("wb") as stream, ProtobufWriter(stream) as writer:
        for k, (sec, nanosec, at) in enumerate(stamps(log)):
            states = JointStates()
            states.timestamp.seconds, states.timestamp.nanos = sec, nanosec
            fields = message(log, k, orders(log)(k))
            for i, name in enumerate(fields["name"]):
                one = states.joints.add()
                one.name = str(name)
                for key in ("position", "velocity", "effort"):
                    setattr(one, key, fields[key][i])
            writer.write_message("/joint_states", states, at, at)


WRITERS = {"json": in_json, "ros2": in_ros2, "protobuf": in_protobuf}


@pytest.mark.parametrize("encoding", WRITERS)
def test_every_encoding_is_read_as_a_csv_is(
    tmp_path: Path, as_csv: MotionLog, encoding: str
) -> None:
    path = tmp_path / "log.mcap"
    WRITERS[encoding](path, as_csv)
    field = "joints.{1}.{0}" if encoding == "protobuf" else "{0}.{1}"
    lines = [
        f"  {name}: {{link_position: {{column: {field.format('position', name)}}}, motor_velocity: "
        f"{{column: {field.format('velocity', name)}}}, current: {{column: "
        f"{field.format('effort', name)}}}}}"
        for name in as_csv.joints
    ]
    path.with_suffix(".yaml").write_text("\n".join(["topic: /joint_states", "joints:", *lines]))
    log, notes = read_csv(path, as_csv.joints, {})
    assert notes == ()
    np.testing.assert_allclose(log.time_s - BEGUN_S, as_csv.time_s, atol=1e-6)
    for name in ("link_position", "motor_velocity", "current"):
        np.testing.assert_array_equal(getattr(log, name), getattr(as_csv, name))


@pytest.mark.parametrize("encoding", WRITERS)
def test_a_configuration_is_drafted_from_one(
    tmp_path: Path, arm: Stranger, as_csv: MotionLog, encoding: str
) -> None:
    path = tmp_path / "log.mcap"
    WRITERS[encoding](path, as_csv)
    given = ["--log-only", "--urdf", str(urdf_of(arm, tmp_path)), str(path)]
    result = CliRunner().invoke(main, ["new", str(tmp_path / "arm"), *given])
    assert result.exit_code == 0, result.output
    log, _ = read_csv(path, as_csv.joints, dict.fromkeys(as_csv.joints, 1.0))
    np.testing.assert_allclose(log.link_position, as_csv.link_position)


@pytest.mark.parametrize(
    ("encoding", "schema", "says"),
    [
        ("cdr", "ros2idl", "/arm is encoded as cdr by ros2idl; json, protobuf, and cdr by ros2msg"),
        ("cbor", "", "/arm is encoded as cbor by no schema"),
        ("protobuf", "protobuf", "the schema of /arm cannot be read"),
    ],
)
def test_what_no_library_reads_is_named(
    tmp_path: Path, encoding: str, schema: str, says: str
) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        known = writer.register_schema("its", schema, b"\x00") if schema else 0
        writer.add_message(writer.register_channel("/arm", encoding, known), 0, b"\x00", 0)
        writer.finish()
    with pytest.raises(LogError, match=says):
        mcap_log.read_rows(path, "/arm")
    with pytest.raises(LogError, match=says):
        mcap_log.headers(path)


def test_without_its_extra_a_log_says_which(
    tmp_path: Path, as_csv: MotionLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_ros2(tmp_path / "log.mcap", as_csv)
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)
    with pytest.raises(LogError, match=r"pip install 'contactd\[logs\]'"):
        mcap_log.read_rows(tmp_path / "log.mcap", "/joint_states")


def test_damaged_messages_and_rows_that_lack_a_number_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/arm", "json", 0)
        writer.add_message(channel, 0, b"{", 0)
        writer.finish()
    with pytest.raises(LogError, match="a message of /arm is no json"):
        mcap_log.read_rows(path, "/arm")
