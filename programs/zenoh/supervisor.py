"""Supervisor of a fleet: observes and stops arms over Zenoh."""

import contextlib
import itertools
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, Literal, Self

import zenoh

from common.errors import UnreachableError
from programs.zenoh.cdr import HEADER, CdrError
from programs.zenoh.fleet import Arm, Fleet, arm_of_token, shown
from programs.zenoh.graph import configuration, reason
from programs.zenoh.messages import read_diagnostic_array, read_diagnostic_status, read_outcome
from programs.zenoh.names import ADMIN, Distro, Endpoint, Kind, Node, Qos, attachment, gid_of
from programs.zenoh.services import TRIGGER
from programs.zenoh.topics import TOPICS

STOP_S: Final = 2.0
MEET_S: Final = 1.0  # time in which a router sends a new client all tokens
LOOKS_EVERY_S: Final = 0.02
EMPTY: Final = HEADER + b"\0"
Outcome = Literal["stands", "not seen to stand", "no answer"]


class Supervisor:
    """Supervisor of all arms of a domain, used as a context."""

    def __init__(self, session: zenoh.Session, domain: int, distro: Distro) -> None:
        self._session, self._domain, self._distro = session, domain, distro
        self._fleet, self._lock = Fleet(), threading.Lock()
        self._numbers = itertools.count(1)
        self._gid = gid_of(str(session.zid()))
        anybody = Node(domain, "/", "anybody", distro)
        hears = anybody.key(self._topic("/diagnostics", "/diagnostics"))
        touches = anybody.key(self._topic("/**/contact", "contact"))
        nodes = f"{ADMIN}/{domain}/*/*/*/{Kind.NODE}/**"
        with contextlib.ExitStack() as opened:
            for declared in (
                session.liveliness().declare_subscriber(nodes, self._meet, history=True),
                session.declare_subscriber(hears, self._hear),
                session.declare_subscriber(touches, self._touch),
            ):
                opened.callback(declared.undeclare)
            self._close = opened.pop_all().close

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def arms(self) -> list[Arm]:
        """All arms known, sorted by name."""
        with self._lock:
            return [self._fleet.arms[name] for name in sorted(self._fleet.arms)]

    def stop(self, names: Iterable[str]) -> dict[str, tuple[Outcome, str]]:
        """Stop these arms, all at once; returns each outcome within STOP_S, and its message."""
        asked = {name: self._ask(name) for name in names}  # all requests are sent before waiting
        return {name: _outcome(replies) for name, replies in asked.items()}

    def stop_all(self) -> dict[str, tuple[Outcome, str]]:
        """Stop all arms that are alive, each as soon as it is discovered within MEET_S; returns as
        `stop`."""
        asked: dict[str, Iterable[zenoh.Reply]] = {}
        until_s = time.monotonic() + MEET_S
        while time.monotonic() < until_s:
            for arm in self.arms():
                if arm.alive and arm.name not in asked:
                    asked[arm.name] = self._ask(arm.name)
            time.sleep(LOOKS_EVERY_S)
        return {name: _outcome(replies) for name, replies in asked.items()}

    def _ask(self, name: str) -> Iterable[zenoh.Reply]:
        node = Node(self._domain, f"/{name}", "contactd", self._distro)
        service = Endpoint(Kind.SERVICE, node.absolute("stop"), TRIGGER, Qos.DEFAULT)
        about = attachment(next(self._numbers), time.time_ns(), self._gid)
        return self._session.get(  # queries all nodes of this name, and yields all their answers
            node.key(service),
            payload=EMPTY,
            attachment=about,
            timeout=STOP_S,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    @staticmethod
    def _topic(name: str, topic: str) -> Endpoint:
        type_name, qos = TOPICS[topic]
        return Endpoint(Kind.PUBLISHER, name, type_name, qos)

    # --- from Zenoh's threads -------------------------------------------------------------------

    def _meet(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        if name := arm_of_token(token, self._domain):
            with self._lock:
                self._fleet.meet(name, sample.kind == zenoh.SampleKind.PUT, token)

    def _hear(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(CdrError):
            found = read_diagnostic_array(sample.payload.to_bytes())
            with self._lock:
                self._fleet.on_diagnostics(found, time.monotonic())

    def _touch(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(CdrError):
            contact = read_diagnostic_status(sample.payload.to_bytes())
            with self._lock:
                self._fleet.touch(contact)


@contextlib.contextmanager
def supervising(
    connect: tuple[str, ...], file: Path | None, domain: int, distro: Distro, timeout_ms: int
) -> Iterator[Supervisor]:
    """Context with a supervisor at these routers, or by a configuration file. Raises
    UnreachableError if no router answers within `timeout_ms`, ConfigurationError as
    `configuration`."""
    config = configuration(connect, file, timeout_ms)
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        where = file or ", ".join(connect)
        raise UnreachableError(f"no router at {where}: {reason(error)} (docs/ros.md)") from error
    with contextlib.closing(session), Supervisor(session, domain, distro) as supervisor:
        yield supervisor


def _outcome(replies: Iterable[zenoh.Reply]) -> tuple[Outcome, str]:
    """Outcome of an arm, which stands if all nodes of its name confirm it."""
    found: tuple[Outcome, str] = ("no answer", "")
    for reply in replies:
        found = _answer(reply)
        if found[0] != "stands":
            break
    return found


def _answer(reply: zenoh.Reply) -> tuple[Outcome, str]:
    if reply.ok is None:
        return "not seen to stand", shown(reply.err.payload.to_string()) if reply.err else ""
    try:
        done, text = read_outcome(reply.ok.payload.to_bytes())
    except CdrError as error:
        return "not seen to stand", f"invalid answer: {error}"
    return ("stands" if done else "not seen to stand"), shown(text)
