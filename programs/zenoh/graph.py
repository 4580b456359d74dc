"""ROS 2 node of the arm in a Zenoh session: its publishers, services and liveliness tokens."""

import contextlib
import itertools
import json
import re
import ssl
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Self

import zenoh
from zenoh import ext

from common.errors import ConfigurationError
from daemon.protocol.text import printable
from programs.zenoh import services
from programs.zenoh.names import (
    ADMIN,
    GID_BYTES,
    Endpoint,
    Node,
    Qos,
    attachment,
    gid_of,
    mismatch,
    read_attachment,
    twin,
)
from programs.zenoh.services import Offer, Service

MOST_REQUEST_BYTES: Final = 1024
MOST_MESSAGE_BYTES: Final = 8192
#: Checked here, as Zenoh retries an invalid endpoint forever.
ENDPOINT: Final = re.compile(r"(tcp|tls|quic|udp|ws)/[^\s\"\\/]+:\d{1,5}")
#: Zenoh appends a path and line of its own sources to errors.
SOURCES: Final = re.compile(r" at /\S+\.rs:\d+\.?$")
KEYS: Final = (
    ("root_ca_certificate",),
    ("connect_certificate", "connect_private_key"),
    ("listen_certificate", "listen_private_key"),
)
MOST_WARNINGS: Final = 64
MOST_SAID: Final = 400  # characters of a warning

Say = Callable[[str], object]
Hear = Callable[[bytes, bytes, float], None]
"""Function that takes a payload, the publisher's GID, and the time at which it was sent [s]."""


class Publisher:
    """Publisher of one topic, which numbers its messages, and drops them rather than block."""

    def __init__(self, session: zenoh.Session, node: Node, endpoint: Endpoint, token: str) -> None:
        latched = endpoint.qos is Qos.LATCHED
        self._gid = gid_of(token)
        self._numbers = itertools.count(1)
        self._publisher = ext.declare_advanced_publisher(
            session,
            node.key(endpoint),
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE,
            cache=ext.CacheConfig(max_samples=1) if latched else None,
            publisher_detection=latched,
        )

    def put(self, payload: bytes) -> None:
        """Send a message. Raises zenoh.ZError once the session is closed."""
        about = attachment(next(self._numbers), time.time_ns(), self._gid)
        self._publisher.put(payload, attachment=about)

    def close(self) -> None:
        """Undeclare the publisher."""
        self._publisher.undeclare()


class Query:
    """Service call received over Zenoh."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        payload = query.payload
        size = len(payload) if payload is not None else 0
        self.request = b"" if payload is None or size > MOST_REQUEST_BYTES else payload.to_bytes()
        self._sequence, self._sent_ns, self.gid = 0, 0, bytes(GID_BYTES)
        with contextlib.suppress(ValueError):
            if query.attachment is not None and len(query.attachment) <= MOST_REQUEST_BYTES:
                about = query.attachment.to_bytes()
                self._sequence, self._sent_ns, self.gid = read_attachment(about)

    @property
    def caller(self) -> str:
        """Name of the caller: its GID, as the attachment contains nothing else."""
        return f"ROS 2 client {self.gid.hex()}"

    @property
    def sent_s(self) -> float:
        """Time at which it was sent, by the caller's clock [s]."""
        return self._sent_ns * 1e-9

    def answer(self, payload: bytes) -> None:
        """Answer with the sequence number and GID of the call, by which rmw_zenoh matches it."""
        about = attachment(self._sequence, time.time_ns(), self.gid)
        with contextlib.suppress(zenoh.ZError):  # the caller is gone
            self._query.reply(self._query.key_expr, payload, attachment=about)
        self._drop()

    def refuse(self, why: str) -> None:
        """Answer with an error."""
        with contextlib.suppress(zenoh.ZError):
            self._query.reply_err(why.encode())
        self._drop()

    def _drop(self) -> None:
        self._query.drop()


class Graph:
    """Node with all its endpoints, from construction to `close`."""

    def __init__(
        self,
        session: zenoh.Session,
        node: Node,
        topics: Mapping[str, Endpoint],
        offers: Mapping[str, Offer],
        say: Say,
        heard: Mapping[str, Hear] | None = None,
    ) -> None:
        """Declare the node; heard: handlers by topic, for those that are subscribed to."""
        self._node, self._say = node, say
        self._ours = dict(topics) | {
            name: services.endpoint(node, name, offer.type_name) for name, offer in offers.items()
        }
        heard = heard or {}
        self._said: set[str] = set()
        self.publishers: dict[str, Publisher] = {}
        with contextlib.ExitStack() as opened:
            live = session.liveliness()
            opened.callback(live.declare_token(node.token()).undeclare)
            for number, (name, endpoint) in enumerate(self._ours.items(), start=1):
                token = node.endpoint_token(number, endpoint)
                if name in offers:
                    self._serve(opened, session, name, offers[name])
                elif name in heard:
                    opened.callback(self._hear(session, endpoint, heard[name]))
                else:
                    self.publishers[name] = Publisher(session, node, endpoint, token)
                    opened.callback(self.publishers[name].close)
                opened.callback(live.declare_token(token).undeclare)
            others = live.declare_subscriber(f"{ADMIN}/{node.domain}/**", self._meet, history=True)
            opened.callback(others.undeclare)
            self._close = opened.pop_all().close

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Undeclare everything."""
        self._close()

    def _serve(
        self, opened: contextlib.ExitStack, session: zenoh.Session, name: str, offer: Offer
    ) -> None:
        service = Service(name, offer)
        opened.callback(service.close)
        key = self._node.key(self._ours[name])

        def take(query: zenoh.Query) -> None:
            call = Query(query)
            if str(query.key_expr) == key:
                service.put(call)
            else:  # a wildcard query, which rmw_zenoh never sends
                call.refuse(f"ask {key}")

        opened.callback(session.declare_queryable(key, take, complete=True).undeclare)

    def _hear(self, session: zenoh.Session, endpoint: Endpoint, hear: Hear) -> Callable[[], None]:
        """Subscribe to a topic; messages without the attachment of rmw_zenoh are ignored. Returns
        the function that unsubscribes."""

        def take(sample: zenoh.Sample) -> None:
            about = sample.attachment
            if about is None or len(sample.payload) > MOST_MESSAGE_BYTES:
                return
            with contextlib.suppress(ValueError):
                _, sent_ns, gid = read_attachment(about.to_bytes())
                hear(sample.payload.to_bytes(), gid, sent_ns * 1e-9)

        return session.declare_subscriber(self._node.key(endpoint), take).undeclare

    def _meet(self, sample: zenoh.Sample) -> None:
        """Report, once, a new entity that cannot match our endpoint, or a node with our name."""
        if sample.kind != zenoh.SampleKind.PUT or len(self._said) >= MOST_WARNINGS:
            return
        token = str(sample.key_expr)
        found = [mismatch(self._node, endpoint, token) for endpoint in self._ours.values()]
        for why in (printable(text)[:MOST_SAID] for text in (twin(self._node, token), *found)):
            if why and why not in self._said:
                self._said.add(why)
                self._say(why)


def configuration(
    connect: tuple[str, ...], file: Path | None, timeout_ms: int = -1, option: str = "--connect"
) -> zenoh.Config:
    """Configuration of a session, from a file or for a client of these routers. A client, also by a
    file, waits `timeout_ms` for its router, or forever if negative. Ours neither listens on a port
    nor sends multicast. Raises ConfigurationError for an invalid file, endpoint or key."""
    if file is not None:
        return _of_file(file, timeout_ms)
    for where in connect:
        if not ENDPOINT.fullmatch(where):
            raise ConfigurationError(
                f"{option} {where}: must be a protocol, host and port, as tcp/localhost:7447"
            )
    config = zenoh.Config()
    values: dict[str, Any] = {
        "mode": '"client"',
        "connect/endpoints": "[" + ", ".join(f'"{where}"' for where in connect) + "]",
        "connect/timeout_ms": str(timeout_ms),
        "connect/exit_on_failure": "false" if timeout_ms < 0 else "true",
        "scouting/multicast/enabled": "false",
        "timestamping/enabled": "true",  # needed for latched topics
        "transport/shared_memory/enabled": "false",  # sandboxes may forbid it, and peers are remote
        # A busy computer delays a link for some ms; messages must not be dropped meanwhile.
        "transport/link/tx/queue/size/data": "16",
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": "50000",
    }
    for key, value in values.items():
        config.insert_json5(key, value)
    return config


def reason(error: zenoh.ZError) -> str:
    """Message of a Zenoh error without its source location."""
    return SOURCES.sub("", str(error))


def _of_file(file: Path, timeout_ms: int) -> zenoh.Config:
    try:
        config = zenoh.Config.from_file(file)
    except zenoh.ZError as error:
        raise ConfigurationError(f"{file}: refused by Zenoh: {reason(error)}") from error
    _refuse_wrong_keys(config, file)
    if timeout_ms >= 0 and json.loads(config.get_json("mode")) == "client":
        config.insert_json5("connect/timeout_ms", str(timeout_ms))
        config.insert_json5("connect/exit_on_failure", "true")
    return config


def _refuse_wrong_keys(config: zenoh.Config, file: Path) -> None:
    """Raise ConfigurationError for invalid certificates and keys, with which Zenoh would retry
    forever without an error."""
    for names in KEYS:
        found = [json.loads(config.get_json(f"transport/link/tls/{name}")) for name in names]
        paths = [path for path in found if path is not None]
        try:
            for path in paths:
                Path(path).read_bytes()
            if len(paths) > 1:
                ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_cert_chain(
                    paths[0], paths[1], password=""
                )
        except ssl.SSLError as error:
            pair = " and ".join(paths)
            raise ConfigurationError(
                f"{file}: {pair} are not a certificate and its key: {error.reason or error}"
            ) from error
        except OSError as error:
            where = f"{', '.join(names)}: {error.filename}"
            raise ConfigurationError(f"{file}: {where}: {error.strerror}") from error


@contextlib.contextmanager
def session_of(config: zenoh.Config) -> Iterator[zenoh.Session]:
    """Context with a Zenoh session."""
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()
