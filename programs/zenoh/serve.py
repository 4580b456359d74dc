"""Main loop of `contactd-zenoh`: receives States from the view socket and publishes them."""

import logging
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import zenoh

from common.errors import ConfigurationError, ContactdError
from daemon.modes.table import Mode
from daemon.protocol.replies import Status
from daemon.protocol.state import Snapshot, State
from programs.clients.client import Client
from programs.zenoh import diagnoses, topics
from programs.zenoh.arming import Arming
from programs.zenoh.following import FollowingThread
from programs.zenoh.graph import Graph, Hear, Say, configuration, reason, session_of
from programs.zenoh.messages import Diagnosis, diagnostic_array
from programs.zenoh.names import Node
from programs.zenoh.services import Offer, actions, trigger

RETRY_S: Final = 0.25
DIAGNOSTICS_S: Final = 1.0
#: A Status costs the daemon more than a tick's States, and values that only it has change slowly.
STATUS_EVERY_S: Final = 60.0
STATUS_APART_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings from the command line; `control`: the control socket or None, required for `arming`
    by others."""

    view: Path
    control: Path | None
    node: Node
    connect: tuple[str, ...]
    configuration: Path | None
    arming: bool = False
    following: bool = False  # accept targets from the network; also requires `control`


def serve(settings: Settings, say: Say, ended: threading.Event) -> None:
    """Serve until `ended`. Raises ConfigurationError for a configuration that Zenoh refuses."""
    logging.getLogger("asyncio").setLevel(logging.WARNING)
    try:
        config = configuration(settings.connect, settings.configuration)
        say(f"looking for a router: {settings.configuration or ', '.join(settings.connect)}")
        with session_of(config) as session:
            node = replace(settings.node, zid=str(session.zid()))
            bridge = Bridge(settings.view, node, say, ended)
            taken, heard = topics.endpoints(node), dict[str, Hear]()
            with ExitStack() as opened:
                if settings.following and settings.control is not None:
                    following = FollowingThread(settings.control, lambda: bridge.joints, say)
                    heard[topics.TARGETS] = opened.enter_context(following).put
                    taken[topics.TARGETS] = topics.targets(node)
                    say("every client of the router may stream targets, unless its rules forbid it")
                graph = opened.enter_context(
                    Graph(session, node, taken, offers(settings), say, heard)
                )
                if settings.arming:
                    say("every client of the router may arm the arm, unless its rules forbid it")
                say(f"node {node.absolute(node.name)} in domain {node.domain}")
                bridge.run(graph)
    except zenoh.ZError as error:
        what = settings.configuration or ", ".join(settings.connect)
        raise ConfigurationError(f"{what}: refused by Zenoh: {reason(error)}") from error


def offers(settings: Settings) -> dict[str, Offer]:
    """Services of an arm, by name."""
    acts = actions(settings.view, settings.control)
    offered = {name: trigger(act) for name, act in acts.items()}
    if settings.arming and settings.control is not None:
        offered["arm"] = Arming.at(settings.control, acts["disarm"]).offer()
    return offered


class Bridge:
    """Bridge that publishes the States of one daemon."""

    def __init__(self, view: Path, node: Node, say: Say, ended: threading.Event) -> None:
        self._view, self._say, self._ended = view, say, ended
        self.joints: list[str] = []
        """Joints of the daemon that was joined last."""
        self._arm = node.namespace.strip("/") or node.name
        self._status: Status | None = None
        self._wanted = threading.Event()  # set if a new Status is wanted
        self._said = ""
        self._due_s = 0.0  # monotonic time of the next message on /diagnostics
        self._key: diagnoses.Key = ()

    def run(self, graph: Graph) -> None:
        """Publish the daemon's States until the end; rejoin it whenever it was gone."""
        self._graph = graph
        asker = threading.Thread(target=self._ask, name="status", daemon=True)
        asker.start()
        while not self._ended.is_set():
            try:
                with Client(self._view) as client:
                    self._follow(client)
            except ContactdError as error:
                self._lose(str(error))
                self._ended.wait(RETRY_S)
        self._wanted.set()
        asker.join()

    def _follow(self, client: Client) -> None:
        snapshot, states = client.subscribe()
        self._said, self._key = "", ()
        self.joints = snapshot.joints
        self._wanted.set()
        self._say(f"joined {snapshot.program}: {', '.join(snapshot.joints)}")
        made = topics.Topics(snapshot, self._arm)
        self._graph.publishers["robot_description"].put(made.description)
        for state in states:
            for name, payload in made.of(state):
                self._graph.publishers[name].put(payload)
            self._diagnose(snapshot, state)
            if self._ended.is_set():
                return

    def _diagnose(self, snapshot: Snapshot, state: State) -> None:
        key, now_s = diagnoses.changed(state), time.monotonic()
        if key != self._key or now_s >= self._due_s:
            if key != self._key and state.mode is Mode.FAULTED:
                self._wanted.set()
            self._key = key
            found = diagnoses.of(state, snapshot.joints, self._arm, self._status)
            self._publish(state.timing.wall_s, found, now_s)

    def _lose(self, why: str) -> None:
        if why != self._said:
            self._said = why
            self._say(why)
        key, now_s = (why,), time.monotonic()
        if key != self._key or now_s >= self._due_s:
            self._key = key
            self._publish(time.time(), diagnoses.gone(self._arm, why), now_s)

    def _publish(self, wall_s: float, found: list[Diagnosis], now_s: float) -> None:
        self._due_s = now_s + DIAGNOSTICS_S
        self._graph.publishers["/diagnostics"].put(diagnostic_array(wall_s, found))

    def _ask(self) -> None:
        """Request a Status, for values that States lack: after joining, at a fault, and every
        STATUS_EVERY_S."""
        while not self._ended.is_set():
            self._wanted.wait(STATUS_EVERY_S)
            self._wanted.clear()
            if self._ended.is_set():
                return
            try:
                with Client(self._view) as client:
                    self._status = client.ask_status()
            except ContactdError:
                self._status = None
            self._ended.wait(STATUS_APART_S)
