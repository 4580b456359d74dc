"""Names of rmw_zenoh: key expressions, liveliness tokens, QoS, and the attachment of a message.

As specified in docs/design.md of rmw_zenoh. A subscriber only receives from a publisher with
exactly the same name, type and type hash. Pure.
"""

import re
import struct
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import xxhash

from common.errors import ConfigurationError
from programs.zenoh.type_hashes import TYPE_HASHES

ADMIN: Final = "@ros2_lv"
NAME: Final = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
#: Placeholder for a hash in Humble.
NO_HASH: Final = "TypeHashNotSupported"
_ATTACHMENT: Final = struct.Struct("<qqB16s")
GID_BYTES: Final = 16


class Distro(StrEnum):
    """Distribution of ROS 2. From Jazzy on, the types used here have equal hashes."""

    HUMBLE = "humble"
    JAZZY = "jazzy"
    KILTED = "kilted"
    ROLLING = "rolling"


class Kind(StrEnum):
    """Kind of an entity in a liveliness token."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVICE = "SS"
    CLIENT = "SC"


class Qos(StrEnum):
    """Quality of service as encoded in a token; empty parts are rmw_zenoh's defaults."""

    DEFAULT = "::,10:,:,:,,"  # reliable, volatile, keep last 10: topics and services
    LATCHED = ":1:,1:,:,:,,"  # reliable, transient local, keep last 1


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Topic or service of a node: absolute name, type as in `TYPE_HASHES`, QoS."""

    kind: Kind
    name: str
    type_name: str
    qos: Qos


@dataclass(frozen=True, slots=True)
class Node:
    """Node in the ROS 2 graph, of a session with the ID `zid`."""

    domain: int
    namespace: str  # begins with a slash; "/" means none
    name: str
    distro: Distro
    zid: str = ""

    def absolute(self, name: str) -> str:
        """Absolute name of a topic in the node's namespace, unless it begins with a slash."""
        return name if name.startswith("/") else f"{self.namespace.rstrip('/')}/{name}"

    def type_hash(self, type_name: str) -> str:
        """Hash of a type as used in keys by this distribution."""
        return NO_HASH if self.distro is Distro.HUMBLE else TYPE_HASHES[type_name]

    def key(self, endpoint: Endpoint) -> str:
        """Key expression for the messages of `endpoint`."""
        return (
            f"{self.domain}/{endpoint.name.strip('/')}/{dds_name(endpoint.type_name)}/"
            f"{self.type_hash(endpoint.type_name)}"
        )

    def token(self) -> str:
        """Liveliness token of the node."""
        return self._token(0, Kind.NODE)

    def endpoint_token(self, number: int, endpoint: Endpoint) -> str:
        """Liveliness token of an endpoint, whose number is unique in this session."""
        return "/".join(
            (
                self._token(number, endpoint.kind),
                mangled(endpoint.name),
                dds_name(endpoint.type_name),
                self.type_hash(endpoint.type_name),
                endpoint.qos,
            )
        )

    def _token(self, number: int, kind: Kind) -> str:
        space = mangled(self.namespace)
        return f"{ADMIN}/{self.domain}/{self.zid}/0/{number}/{kind}/%/{space}/{self.name}"


def mangled(name: str) -> str:
    """Name encoded as one part of a key."""
    return name.replace("/", "%")


def dds_name(type_name: str) -> str:
    """DDS name of a type: `std_msgs::msg::dds_::String_` for `std_msgs/msg/String`."""
    package, space, name = type_name.split("/")
    return f"{package}::{space}::dds_::{name}_"


def gid_of(token: str) -> bytes:
    """GID of the entity with this token: the token's 128-bit XXH3 hash."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(GID_BYTES, "little")


def attachment(sequence: int, wall_ns: int, gid: bytes) -> bytes:
    """Attachment of a message, beside its payload."""
    return _ATTACHMENT.pack(sequence, wall_ns, GID_BYTES, gid)


def read_attachment(packet: bytes) -> tuple[int, int, bytes]:
    """Sequence number, source time [ns] and GID. Raises ValueError for anything else."""
    if len(packet) != _ATTACHMENT.size:
        raise ValueError(f"an attachment has {_ATTACHMENT.size} bytes, not {len(packet)}")
    sequence, wall_ns, size, gid = _ATTACHMENT.unpack(packet)
    if size != GID_BYTES:
        raise ValueError(f"a GID has {GID_BYTES} bytes, not {size}")
    return sequence, wall_ns, gid


def mismatch(node: Node, ours: Endpoint, token: str) -> str:
    """Reason why an entity with this token, and the name of our endpoint, cannot communicate with
    it; empty if it can, or has another name."""
    parts = token.split("/")
    if len(parts) != 13 or parts[0] != ADMIN or parts[9] != mangled(ours.name):
        return ""
    who = f"{parts[7]}/{parts[8]}".replace("%", "/").replace("//", "/")
    if parts[10] != dds_name(ours.type_name):
        return f"{who} expects {parts[10]} on {ours.name}, which is {dds_name(ours.type_name)}"
    if parts[11] != node.type_hash(ours.type_name):
        other = "Humble" if parts[11] == NO_HASH else "another distribution"
        return f"{who} uses {other}: {ours.name} has another type hash there (--distro)"
    return ""


def twin(node: Node, token: str) -> str:
    """Warning about another node with our name; empty if this token is not of one."""
    ours, parts = node.token().split("/"), token.split("/")
    if parts[5:] != ours[5:] or parts[:2] != ours[:2] or parts[2] == node.zid:
        return ""
    return (
        f"another contactd-zenoh has --namespace {node.namespace}: messages to one reach both; "
        "give each arm its own"
    )


def checked_namespace(text: str) -> str:
    """Namespace from the command line. Raises ConfigurationError if it is invalid."""
    if text == "/" or NAME.fullmatch(text):
        return text
    raise ConfigurationError(
        f"--namespace {text}: must be a slash and letters, digits or _, once or more: /left_arm"
    )
