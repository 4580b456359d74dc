"""Supervisor of a fleet at work: what it hears over Zenoh, and the stops that it asks for."""

import contextlib
import itertools
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Final, Literal, Self

import zenoh

from daemon.ros.cdr import HEADER, CdrError
from daemon.ros.fleet import Arm, Fleet, arm_of_token, shown
from daemon.ros.graph import configuration, reason
from daemon.ros.messages import read_diagnostic_array, read_diagnostic_status, read_outcome
from daemon.ros.names import ADMIN, Distro, Endpoint, Kind, Node, Qos, attachment, gid_of
from daemon.ros.services import TRIGGER
from daemon.ros.topics import TOPICS
from errors import UnreachableError

STOP_S: Final = 2.0
MEET_S: Final = 1.0  # in which a router tells a newcomer of all tokens
LOOKS_EVERY_S: Final = 0.02
EMPTY: Final = HEADER + b"\0"
Outcome = Literal["stands", "not seen to stand", "no answer"]


class Supervisor:
    """Listener to all arms of a domain, from construction to `close`."""

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()

    def arms(self) -> list[Arm]:
        """Every arm that was ever seen, by name."""
        with self._lock:
            return [self._fleet.arms[name] for name in sorted(self._fleet.arms)]

    def stop(self, names: Iterable[str]) -> dict[str, tuple[Outcome, str]]:
        """Stop these arms, all at once: what became of each within STOP_S, and what it said."""
        asked = {name: self._ask(name) for name in names}  # each waits by itself
        return {name: _outcome(replies) for name, replies in asked.items()}

    def stop_all(self) -> dict[str, tuple[Outcome, str]]:
        """Stop every arm that is alive, each as soon as it is known of, for MEET_S; otherwise as
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
        return self._session.get(  # every one of this name, and what each of them says
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
                self._fleet.hear(found, time.monotonic())

    def _touch(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(CdrError):
            contact = read_diagnostic_status(sample.payload.to_bytes())
            with self._lock:
                self._fleet.touch(contact)


@contextlib.contextmanager
def supervising(
    connect: tuple[str, ...], file: Path | None, domain: int, distro: Distro, patience_ms: int
) -> Iterator[Supervisor]:
    """A supervisor at these routers, or as a file says, while the block lasts. Raises
    UnreachableError where there is no router within `patience_ms` [ms], ConfigurationError as
    `configuration`."""
    config = configuration(connect, file, patience_ms)
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        where = file or ", ".join(connect)
        raise UnreachableError(f"no router at {where}: {reason(error)}") from error
    with contextlib.closing(session), Supervisor(session, domain, distro) as supervisor:
        yield supervisor


def _outcome(replies: Iterable[zenoh.Reply]) -> tuple[Outcome, str]:
    """What became of an arm: it stands where whoever has its name says so."""
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
        return "not seen to stand", f"its answer is none: {error}"
    return ("stands" if done else "not seen to stand"), shown(text)
