"""Names of rmw_zenoh: keys, tokens, attachments, and reported mismatches."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from zenoh_ros2_sdk.attachment import Attachment
from zenoh_ros2_sdk.qos import QosDurability, QosProfile

from common.errors import ConfigurationError
from programs.zenoh import topics
from programs.zenoh.names import (
    NO_HASH,
    Distro,
    Endpoint,
    Kind,
    Node,
    Qos,
    attachment,
    checked_namespace,
    gid_of,
    mismatch,
    read_attachment,
)
from programs.zenoh.type_hashes import TYPE_HASHES

NODE = Node(7, "/left_arm", "contactd", Distro.JAZZY, "abc")
STATES = Endpoint(
    Kind.PUBLISHER, "/left_arm/joint_states", "sensor_msgs/msg/JointState", Qos.DEFAULT
)
HASH = TYPE_HASHES["sensor_msgs/msg/JointState"]


def test_keys_and_tokens_are_those_of_rmw_zenoh() -> None:
    """As the examples in its docs/design.md have them."""
    assert NODE.key(STATES) == f"7/left_arm/joint_states/sensor_msgs::msg::dds_::JointState_/{HASH}"
    assert NODE.token() == "@ros2_lv/7/abc/0/0/NN/%/%left_arm/contactd"
    assert NODE.endpoint_token(3, STATES) == (
        "@ros2_lv/7/abc/0/3/MP/%/%left_arm/contactd/%left_arm%joint_states/"
        f"sensor_msgs::msg::dds_::JointState_/{HASH}/::,10:,:,:,,"
    )
    humble = Node(0, "/", "contactd", Distro.HUMBLE, "abc")
    assert humble.key(STATES).endswith("/TypeHashNotSupported")
    assert humble.token() == "@ros2_lv/0/abc/0/0/NN/%/%/contactd"


def test_names_below_a_namespace() -> None:
    names = {name: e.name for name, e in topics.endpoints(NODE).items()}
    assert names["joint_states"] == "/left_arm/joint_states"
    assert names["/diagnostics"] == "/diagnostics"
    assert Node(0, "/", "contactd", Distro.JAZZY).absolute("contact") == "/contact"


def test_qos_reads_back_elsewhere() -> None:
    stream, latched = QosProfile.decode(Qos.DEFAULT), QosProfile.decode(Qos.LATCHED)
    assert (stream.history_depth, stream.durability) == (10, QosDurability.VOLATILE)
    assert (latched.history_depth, latched.durability) == (1, QosDurability.TRANSIENT_LOCAL)


def test_a_gid_is_the_hash_of_the_token() -> None:
    """XXH3 of 128 bits, low half first: xxhash's own figure for the empty input, reversed."""
    assert gid_of("")[::-1].hex() == "99aa06d3014798d86001c324468d497f"
    assert gid_of(NODE.token()) != gid_of(NODE.endpoint_token(3, STATES))
    assert len(gid_of(NODE.token())) == 16


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1), st.binary(min_size=16, max_size=16))
def test_attachments_read_back_elsewhere(sequence: int, wall_ns: int, gid: bytes) -> None:
    sent = attachment(sequence, wall_ns, gid)
    assert Attachment.from_bytes(sent) == Attachment(sequence, wall_ns, gid)
    assert Attachment(sequence, wall_ns, gid).to_bytes() == sent
    assert read_attachment(sent) == (sequence, wall_ns, gid)


@given(st.binary(max_size=40))
def test_an_invalid_attachment_is_refused(packet: bytes) -> None:
    if len(packet) == 33 and packet[16] == 16:
        assert read_attachment(packet)[2] == packet[17:]
        return
    with pytest.raises(ValueError, match="has"):
        read_attachment(packet)


OTHER = "@ros2_lv/7/zid/0/5/MS/%/%/planner/%left_arm%joint_states/"
MISMATCHES = [
    (OTHER + f"sensor_msgs::msg::dds_::JointState_/{HASH}/::,:,:,:,,", ""),
    (
        OTHER + "sensor_msgs::msg::dds_::JointState_/RIHS01_00/::,:,:,:,,",
        "/planner uses another distribution: /left_arm/joint_states has another type hash there",
    ),
    (OTHER + f"sensor_msgs::msg::dds_::JointState_/{NO_HASH}/::,:,:,:,,", "/planner uses Humble:"),
    (
        OTHER + f"std_msgs::msg::dds_::String_/{HASH}/::,:,:,:,,",
        "/planner expects std_msgs::msg::dds_::String_ on /left_arm/joint_states, which is sensor_",
    ),
    ("@ros2_lv/7/zid/0/5/MS/%/%/planner/%other/x/y/::,:,:,:,,", ""),
    ("@ros2_lv/7/zid/0/0/NN/%/%/planner", ""),
    ("nonsense", ""),
    ("@ros2_lv/" * 40, ""),
]


@pytest.mark.parametrize(("token", "words"), MISMATCHES)
def test_a_mismatching_subscriber_is_reported(token: str, words: str) -> None:
    said = mismatch(NODE, STATES, token)
    assert said.startswith(words)
    assert bool(said) is bool(words)


@pytest.mark.parametrize(
    "text", ["", "arm", "/", "/a/b_2", "/2a", "/a/", "//", "/a*", "/ä", "/a\n"]
)
def test_only_namespaces_valid_in_ros_are_accepted(text: str) -> None:
    if text in ("/", "/a/b_2"):
        assert checked_namespace(text) == text
    else:
        with pytest.raises(ConfigurationError, match="--namespace"):
            checked_namespace(text)
