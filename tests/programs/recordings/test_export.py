"""Exports: valid by Foxglove's published schemas, with all values of the recording."""

import base64
import csv
import json
import math
import os
import socket
import struct
import threading
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pinocchio
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from bench.rigs.lockstep import DESK_ARM, ROMEO
from daemon.protocol.state import Snapshot, Wrench
from programs.clients.client import Client
from programs.contactd.contactd import main
from programs.foxglove.server import serve
from programs.identify.csv_log import read_csv
from programs.recordings.foxglove import POINT
from programs.recordings.skeleton import Quaternion, product, rotated, skeleton_of, towards
from tests.fake_daemon import JOINTS, snapshot_at, state_at
from tests.programs.clients.test_recorder import FORMATS
from tests.programs.clients.test_replay import written
from tests.programs.recordings.test_touch_point import POSE, pushed

ROMEO_URDF = (ROMEO / "arm.urdf").read_text()


def with_urdf(snapshot: Snapshot) -> Snapshot:
    return msgspec.structs.replace(snapshot, urdf=ROMEO_URDF)


PUSH = Wrench(
    force=[0.0, 0.0, -18.0], covariance=[9.0, 0.0, 0.0, 1.0, 0.0, 4.0], unseen=[], strength=4.0,
    misfit=0.8,
)  # fmt: skip


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    states = [
        state_at(k, touched_link="LShoulderYaw" if 100 <= k < 200 else "", wrench=PUSH)
        for k in range(90, 250)
    ]
    return written(tmp_path / "made.mcap", [with_urdf(snapshot_at(89)), *states])


def export(*arguments: object) -> Any:
    return CliRunner().invoke(main, ["export", *map(str, arguments)])


def test_foxglove_marks_the_point_of_contact_as_long_as_it_is_known(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    residual = pushed(6, (0.06, 0.01, 0.0), (3.0, 14.0, -9.0)).tolist()
    states = [
        state_at(k, link_position=POSE.tolist(), residual=residual if k < 60 else [0.0] * 7)
        for k in range(20, 90)
    ]
    target = tmp_path / "out.mcap"
    made = written(tmp_path / "made.mcap", [with_urdf(snapshot_at(19)), *states])
    assert export(made, "--foxglove", "-o", target).exit_code == 0
    updates = decoded(target)["/touch"]
    marks = [entity for update in updates for entity in update.entities]
    assert {mark.frame_id for mark in marks} == {"l_wrist"}
    at, size = marks[-1].spheres[0].pose.position, marks[-1].spheres[0].size.x
    assert math.dist((at.x, at.y, at.z), (0.06, 0.01, 0.0)) < 0.5 * size < 0.09
    assert [gone.id for gone in updates[-1].deletions] == [POINT]


# --- the skeleton ---------------------------------------------------------------------------------


@pytest.mark.parametrize("folder", [ROMEO, DESK_ARM])
def test_frames_are_where_pinocchio_puts_them(folder: Path) -> None:
    urdf = next(folder.glob("*.urdf")).read_text()
    skeleton = skeleton_of(urdf)
    robot = pinocchio.buildModelFromXML(urdf)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = rng.uniform(-1.0, 1.0, robot.nq)
        data = robot.createData()
        pinocchio.framesForwardKinematics(robot, data, q)
        places: dict[str, tuple[Any, Quaternion]] = {
            skeleton.root: (np.zeros(3), (0.0, 0.0, 0.0, 1.0))
        }
        for frame in skeleton.frames:
            known = robot.existJointName(frame.joint)
            at = q[robot.joints[robot.getJointId(frame.joint)].idx_q] if known else 0.0
            xyz, turned = frame.at(float(at))
            origin, rotation = places[frame.parent]
            places[frame.child] = (origin + rotated(rotation, xyz), product(rotation, turned))
            expected = data.oMf[robot.getFrameId(frame.child)]
            np.testing.assert_allclose(places[frame.child][0], expected.translation, atol=1e-9)
            for axis in np.eye(3):
                np.testing.assert_allclose(
                    rotated(places[frame.child][1], axis), expected.rotation @ axis, atol=1e-9
                )


@pytest.mark.parametrize("way", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.3, -0.2, 0.1)])
def test_capsules_point_along_their_link(way: Any) -> None:
    along = np.array(way) / np.linalg.norm(way)
    np.testing.assert_allclose(rotated(towards(way), (0.0, 0.0, 1.0)), along, atol=1e-9)


# --- Foxglove -------------------------------------------------------------------------------------


def decoded(path: Path) -> dict[str, list[Any]]:
    """Messages by topic, decoded by the schemas in the file."""
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    found: dict[str, list[Any]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.message_encoding == "json":
                found.setdefault(channel.topic, []).append(json.loads(message.data))
        topics = ["/tf", "/scene", "/touch", "/joint_states", "/log"]
        for _, channel, _, message in reader.iter_decoded_messages(topics=topics):
            found.setdefault(channel.topic, []).append(message)
    return found


def test_foxglove_gets_the_arm_its_values_and_its_log(recording: Path, tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    target = tmp_path / "out.mcap"
    answer = export(recording, "--foxglove", "-o", target)
    assert answer.exit_code == 0, answer.output
    found = decoded(target)
    assert len(found["/joints/LElbowYaw"]) == len(found["/arm"]) == 160
    assert found["/wrench"] == [msgspec.to_builtins(PUSH)] * 160
    one = found["/joints/LShoulderYaw"][20]
    expected = state_at(110)
    assert one["residual"] == expected.residual[1]
    assert one["beside"] == {"classical": expected.beside["classical"][1]}
    assert one["side"] == expected.side[1]
    assert [log.message for log in found["/log"]] == ["contact at LShoulderYaw"]
    # Dark, lit, dark again: each only once.
    lit = [
        [entity.id for entity in update.entities if entity.spheres[0].color.r > 0.8]
        for update in found["/scene"]
    ]
    assert lit == [[], ["LShoulderYawLink"], []]
    frames = [transform.child_frame_id for transform in found["/tf"][0].transforms]
    assert frames[:-1] == [f"{joint}Link" for joint in JOINTS[:-1]]
    assert found["/joint_states"][0].joints[2].name == JOINTS[2]


def published(name: str) -> Any:
    """A message of the package of Foxglove's own schemas."""
    module = pytest.importorskip(f"foxglove_schemas_protobuf.{name}_pb2")
    return getattr(module, name)


def test_the_messages_are_those_of_the_published_schemas(recording: Path, tmp_path: Path) -> None:
    """The package of Foxglove's schemas decodes the values written, field by field."""
    pytest.importorskip("foxglove")
    unknown_fields = pytest.importorskip("google.protobuf.unknown_fields")
    target = tmp_path / "out.mcap"
    assert export(recording, "--foxglove", "-o", target).exit_code == 0
    kinds = {"/tf": published("FrameTransforms"), "/scene": published("SceneUpdate")}
    kinds["/log"] = published("Log")
    seen = set()
    with target.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if (kind := kinds.get(channel.topic)) is not None:
                assert schema is not None
                assert schema.name == kind.DESCRIPTOR.full_name
                read = kind.FromString(message.data)
                assert not len(unknown_fields.UnknownFieldSet(read))
                seen.add(channel.topic)
    assert seen == set(kinds)


# --- CSV and labels -------------------------------------------------------------------------------


def test_the_csv_is_what_identify_reads(recording: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.csv"
    assert export(recording, "--csv", "-o", target).exit_code == 0
    log = read_csv(target, JOINTS, {})[0]
    expected = np.array([state_at(k).current for k in range(90, 250)])
    np.testing.assert_array_equal(log.current, expected)
    with target.open() as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["residual.LShoulderYaw"]) for row in rows] == [
        state_at(k).residual[1] for k in range(90, 250)
    ]
    assert rows[15]["mode"] == "admittance"


@pytest.mark.parametrize("form", ["--csv", "--labels", "--foxglove"])
def test_no_file_is_overwritten_and_nothing_is_left_half_written(
    recording: Path, tmp_path: Path, form: str
) -> None:
    pytest.importorskip("foxglove")
    target = tmp_path / "precious"
    target.write_text("precious")
    answer = export(recording, form, "-o", target)
    assert answer.exit_code == 65
    assert "never overwritten" in answer.stderr
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(b"PK\x03\x04")
    answer = export(foreign, form, "-o", tmp_path / "new")
    assert answer.exit_code != 0
    assert "is not an MCAP file" in answer.stderr
    left = {path.name for path in tmp_path.iterdir()}
    assert left <= {"precious", "made.mcap", "foreign.mcap", "new"}
    assert form == "--labels" or not (tmp_path / "new").exists()


@pytest.mark.parametrize("version", FORMATS)
@pytest.mark.parametrize("form", ["--csv", "--foxglove"])
def test_a_recording_of_each_format_is_exported(version: int, form: str, tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    assert export(FORMATS[version], form, "-o", tmp_path / "out").exit_code == 0


def test_a_form_must_be_named(recording: Path) -> None:
    answer = export(recording)
    assert answer.exit_code == 2
    assert "--foxglove, --csv, --labels or --lerobot" in answer.stderr


# --- live -----------------------------------------------------------------------------------------


class Viewer:
    """As much of Foxglove's WebSocket protocol as a viewer needs."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=60.0)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        self._stream = self._socket.makefile("rb")
        while self._stream.readline().strip():
            pass

    def frame(self) -> tuple[int, bytes]:
        first, second = self._stream.read(2)
        size = second & 0x7F
        if size == 126:
            (size,) = struct.unpack(">H", self._stream.read(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", self._stream.read(8))
        return first & 0x0F, self._stream.read(size)

    def say(self, message: Any) -> None:
        text = json.dumps(message).encode()
        mask = bytes(4)
        size = (
            bytes([0x80 | len(text)]) if len(text) < 126 else b"\xfe" + struct.pack(">H", len(text))
        )
        self._socket.sendall(b"\x81" + size + mask + text)

    def close(self) -> None:
        self._stream.close()
        self._socket.close()


def test_a_viewer_sees_the_arm_live(fake_daemon: Any) -> None:
    pytest.importorskip("foxglove")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]

    class FromRomeo(Client):
        def subscribe(self) -> Any:
            snapshot, states = super().subscribe()
            return with_urdf(snapshot), states

    ended, reported = threading.Event(), threading.Event()
    serving = threading.Thread(
        target=serve,
        args=(lambda: FromRomeo(fake_daemon.path, 60.0), "127.0.0.1", port, 33.0),
        kwargs={"report": lambda text: reported.set(), "going": lambda: not ended.is_set()},
    )
    serving.start()
    try:
        assert reported.wait(60.0)
        viewer = Viewer(port)
        channels: dict[str, int] = {}
        while "/joints/LElbowYaw" not in channels or "/scene" not in channels:
            opcode, data = viewer.frame()
            if opcode == 1 and (said := json.loads(data)).get("op") == "advertise":
                channels |= {one["topic"]: one["id"] for one in said["channels"]}
        topics = ("/joints/LElbowYaw", "/scene")
        subscriptions = [{"id": k, "channelId": channels[t]} for k, t in enumerate(topics)]
        viewer.say({"op": "subscribe", "subscriptions": subscriptions})
        seen: set[int] = set()
        while len(seen) < 2:
            opcode, data = viewer.frame()
            if opcode == 2 and data[0] == 1:
                (subscription,) = struct.unpack("<I", data[1:5])
                seen.add(subscription)
                if subscription == 0:
                    assert "residual" in json.loads(data[13:])
        viewer.close()
    finally:
        ended.set()
        serving.join(60.0)
    assert not serving.is_alive()
