"""The bridge between a daemon's socket and a router, with zenoh-ros2-sdk, which is not ours."""

import contextlib
import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore
from zenoh import ext
from zenoh_ros2_sdk import discovery

from common.errors import ConfigurationError
from daemon.protocol.state import State
from programs.zenoh.messages import outcome
from programs.zenoh.names import Distro, Endpoint, Kind, Node, Qos, attachment, read_attachment
from programs.zenoh.serve import Settings, serve
from programs.zenoh.services import TRIGGER
from tests.fake_daemon import state_at
from tests.programs.zenoh.bridge import Bridge, caller, joint_state, until
from tests.programs.zenoh.zenoh_router import session_at

STORE = get_typestore(Stores.ROS2_JAZZY)
NODE = Node(0, "/left_arm", "contactd", Distro.JAZZY)
EMPTY = b"\0\1\0\0\0"


def topic(name: str, type_name: str) -> str:
    return NODE.key(Endpoint(Kind.PUBLISHER, NODE.absolute(name), type_name, Qos.DEFAULT))


def service(name: str) -> str:
    return NODE.key(Endpoint(Kind.SERVICE, NODE.absolute(name), TRIGGER, Qos.DEFAULT))


@pytest.fixture
def bridge(fake_daemon: Any, routed: int, other: zenoh.Session, start: Any) -> Bridge:
    """The bridge, once a call of the other session reaches it; this one is refused."""
    begun: Bridge = start(fake_daemon.path, routed)
    begun.joined()
    until(lambda: list(other.get(service("disarm"), payload=b"none")))
    return begun


def subscribed(other: zenoh.Session, name: str, kind: str) -> Callable[[], Any]:
    """Result of a subscription: waits for the first message, and reads it by rosbags."""
    got: list[bytes] = []
    key = topic(name, kind)
    other.declare_subscriber(key, lambda sample: got.append(sample.payload.to_bytes()))
    return lambda: STORE.deserialize_cdr(until(lambda: got and got[0]), kind)


def state_of(message: Any) -> State:
    """State of the fake daemon from which a stamped message was made."""
    stamp = message.header.stamp
    return state_at(round((stamp.sec + stamp.nanosec * 1e-9 - 1.8e9) * 100))


# --- as another program sees it ------------------------------------------------------------------


def test_topics_and_services_are_listed(fake_daemon: Any, sdk: int, start: Any) -> None:
    start(fake_daemon.path, sdk)
    expected = {
        "/diagnostics": ["diagnostic_msgs/msg/DiagnosticArray"],
        "/left_arm/contact": ["diagnostic_msgs/msg/DiagnosticStatus"],
        "/left_arm/contact_threshold": ["sensor_msgs/msg/JointState"],
        "/left_arm/external_torque": ["sensor_msgs/msg/JointState"],
        "/left_arm/joint_states": ["sensor_msgs/msg/JointState"],
        "/left_arm/robot_description": ["std_msgs/msg/String"],
        "/left_arm/wrench": ["geometry_msgs/msg/WrenchStamped"],
        "/left_arm/wrench_covariance": ["std_msgs/msg/Float64MultiArray"],
    }
    where = (0, "127.0.0.1", sdk)
    until(lambda: dict(discovery.get_topic_names_and_types(*where)) == expected)
    trigger = ["std_srvs/srv/Trigger"]
    offered = {"/left_arm/disarm": trigger, "/left_arm/stop": trigger}
    until(lambda: dict(discovery.get_service_names_and_types(*where)) == offered)


def test_joint_states_are_read_and_disarm_is_called(fake_daemon: Any, sdk: int, start: Any) -> None:
    start(fake_daemon.path, sdk).joined()
    message = joint_state("/left_arm/joint_states", sdk)
    state = state_of(message)
    assert list(message.position) == state.link_position
    assert list(message.velocity) == state.link_velocity
    assert list(message.effort) == state.motor_torque
    type_hash = service("disarm").rpartition("/")[2]
    client = caller("/left_arm/disarm", sdk, "std_srvs/srv/Trigger", type_hash=type_hash)
    reply = until(lambda: client.call(structure_needs_at_least_one_member=0))
    client.close()
    assert (reply.success, reply.message) == (True, "stands")
    assert "disarm" in [command for command, _ in fake_daemon.seen]


@pytest.mark.usefixtures("bridge")
def test_an_answer_carries_the_number_and_the_gid_of_its_call(other: zenoh.Session) -> None:
    """By which rmw_zenoh finds who waits for it."""
    about = attachment(7, 1, b"a gid of 16 byte")
    (reply,) = other.get(service("stop"), payload=EMPTY, attachment=about)
    number, _, gid = read_attachment(reply.ok.attachment.to_bytes())
    assert (number, gid) == (7, b"a gid of 16 byte")
    assert reply.ok.payload.to_bytes() == outcome(True, "stands")


# --- byte by byte --------------------------------------------------------------------------------


def test_every_state_arrives_in_order(
    fake_daemon: Any, routed: int, other: zenoh.Session, start: Any
) -> None:
    got: list[tuple[bytes, tuple[int, int, bytes]]] = []

    def take(sample: zenoh.Sample) -> None:
        got.append((sample.payload.to_bytes(), read_attachment(sample.attachment.to_bytes())))

    key = topic("external_torque", "sensor_msgs/msg/JointState")
    subscriber = other.declare_subscriber(key, take)
    start(fake_daemon.path, routed)
    until(lambda: len(got) >= 100)
    subscriber.undeclare()
    numbers = [about[0] for _, about in got]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert len({about[2] for _, about in got}) == 1
    for payload, _ in got[:100]:
        message = STORE.deserialize_cdr(payload, "sensor_msgs/msg/JointState")
        assert list(message.effort) == state_of(message).residual
        assert list(message.position) == []


def test_a_contact_is_an_event(
    fake_daemon: Any, routed: int, other: zenoh.Session, start: Any
) -> None:
    notices = state_at(100).notices
    fake_daemon.states = lambda tick: state_at(tick, notices=notices if tick % 20 == 0 else [])
    first = subscribed(other, "contact", "diagnostic_msgs/msg/DiagnosticStatus")
    start(fake_daemon.path, routed)
    message = first()
    assert (message.level, message.name, message.hardware_id) == (1, "LShoulderYaw", "left_arm")
    values = {pair.key: pair.value for pair in message.values}
    assert values["torque"] == "-1.3"
    assert (values["level"], values["side"]) == ("contact", "left")


def test_the_torque_of_a_joint_that_does_not_sense_is_nan(
    fake_daemon: Any, routed: int, other: zenoh.Session, start: Any
) -> None:
    fake_daemon.states = lambda tick: state_at(tick, sensing=[True, False] + [True] * 5)
    first = subscribed(other, "external_torque", "sensor_msgs/msg/JointState")
    start(fake_daemon.path, routed)
    assert list(map(math.isnan, first().effort)) == [False, True] + [False] * 5


def test_a_late_subscriber_gets_the_description(
    fake_daemon: Any, routed: int, other: zenoh.Session, start: Any
) -> None:
    bridge = start(fake_daemon.path, routed)
    bridge.joined()
    got: list[bytes] = []
    subscriber = ext.declare_advanced_subscriber(
        other,
        topic("robot_description", "std_msgs/msg/String"),
        lambda sample: got.append(sample.payload.to_bytes()),
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
    )
    payload = until(lambda: got and got[0])
    subscriber.undeclare()
    assert STORE.deserialize_cdr(payload, "std_msgs/msg/String").data == "<robot/>"


# --- what goes wrong -----------------------------------------------------------------------------


def test_a_daemon_that_ends_is_stale_and_comes_back(
    fake_daemon: Any, routed: int, diagnostics: list[Any], start: Any
) -> None:
    got = diagnostics
    bridge = start(fake_daemon.path, routed)
    names = [status.name for status in until(lambda: got and got[-1]).status]
    assert names[:2] == ["contactd: left_arm", "contactd: left_arm: LShoulderPitch"]
    fake_daemon.stopped.set()
    stale = until(lambda: got[-1].status[0].level == 3 and got[-1])
    assert len(stale.status) == 1
    until(lambda: bridge.heard("no contactd serves"))
    fake_daemon.stopped.clear()
    thread = threading.Thread(target=fake_daemon.run)
    thread.start()
    until(lambda: got[-1].status[0].level == 0)
    fake_daemon.stopped.set()
    thread.join()


def test_a_router_that_dies_and_returns(fake_daemon: Any, port: int, start: Any) -> None:
    """The bridge goes on, stays subscribed to the daemon, and its topics resume."""
    where = f"tcp/127.0.0.1:{port}"
    bridge = start(fake_daemon.path, port)  # there is no router yet
    for _ in range(2):
        opened = session_at(where, "router")
        got: list[Any] = []
        with contextlib.closing(session_at(where, "client")) as other:
            other.declare_subscriber("0/left_arm/joint_states/**", got.append)
            until(lambda got=got: len(got) > 10)
        opened.close()
        assert bridge.thread.is_alive()
    assert [line for line in bridge.said if "joined" in line] == [
        "joined contactd 0.1.0: LShoulderPitch, LShoulderYaw, LElbowRoll, LElbowYaw, LWristRoll, "
        "LWristYaw, LWristPitch"
    ]


HOSTILE = [
    (service("stop"), b"\0" * 1_000_000, None, "no Trigger request"),
    (service("stop"), b"\xff\xff", b"x" * 1_000_000, "no Trigger request"),
    (service("stop"), None, None, "no Trigger request"),
    ("0/**", EMPTY, None, "ask 0/left_arm/"),
    ("0/left_arm/stop/*/*", EMPTY, None, "ask 0/left_arm/stop/"),
]


@pytest.mark.parametrize(("key", "payload", "about", "words"), HOSTILE)
@pytest.mark.usefixtures("bridge")
def test_hostile_calls_do_nothing(
    fake_daemon: Any, other: zenoh.Session, key: str, payload: Any, about: Any, words: str
) -> None:
    replies = list(other.get(key, payload=payload, attachment=about))
    refused = [reply.err.payload.to_string() for reply in replies if reply.err is not None]
    assert refused
    assert all(words in said for said in refused)
    assert not {"stop", "disarm"} & {command for command, _ in fake_daemon.seen}


def test_a_thousand_stops_are_a_few_commands(
    fake_daemon: Any, other: zenoh.Session, bridge: Bridge
) -> None:
    answered: list[bool] = []
    for _ in range(1000):
        other.get(service("stop"), lambda reply: answered.append(bool(reply.ok)), payload=EMPTY)
    until(lambda: len(answered) >= 1000)
    assert any(answered)
    asked = [command for command, _ in fake_daemon.seen].count("stop")
    assert 1 <= asked < 1000
    assert bridge.thread.is_alive()


@pytest.mark.usefixtures("bridge")
def test_nothing_that_moves_is_offered(other: zenoh.Session) -> None:
    def offered() -> set[str]:
        tokens = [str(reply.ok.key_expr) for reply in other.liveliness().get("@ros2_lv/**")]
        return {token.split("/")[9] for token in tokens if token.split("/")[5] == "SS"}

    until(lambda: len(offered()) > 1)
    assert offered() == {"%left_arm%stop", "%left_arm%disarm"}
    for name in ("enable", "arm", "reset", "start"):
        assert list(other.get(service(name), payload=EMPTY)) == []


def test_another_distribution_is_reported(
    fake_daemon: Any, routed: int, other: zenoh.Session, start: Any
) -> None:
    token = "@ros2_lv/0/zid/0/5/MS/%/%/planner/%left_arm%joint_states/"
    token += "sensor_msgs::msg::dds_::JointState_/TypeHashNotSupported/::,10:,:,:,,"
    with contextlib.ExitStack() as opened:
        opened.callback(other.liveliness().declare_token(token).undeclare)
        bridge = start(fake_daemon.path, routed)
        until(lambda: bridge.heard("/planner uses Humble"))


@pytest.mark.parametrize("text", ["{", '{mode: "emperor"}', '{connect: {endpoints: ["x"]}}'])
def test_a_file_that_zenoh_refuses_is_reported(fake_daemon: Any, tmp_path: Path, text: str) -> None:
    file = tmp_path / "session.json5"
    file.write_text(text)
    settings = Settings(fake_daemon.path, None, NODE, (), file)
    with pytest.raises(ConfigurationError, match=r"session\.json5: refused by Zenoh: "):
        serve(settings, print, threading.Event())


@pytest.mark.parametrize("where", ["", "localhost:7447", "tcp/localhost", "udp//", 'tcp/a"b:1'])
def test_a_wrong_endpoint_is_refused(fake_daemon: Any, where: str) -> None:
    settings = Settings(fake_daemon.path, None, NODE, (where,), None)
    with pytest.raises(ConfigurationError, match="--connect "):
        serve(settings, print, threading.Event())
