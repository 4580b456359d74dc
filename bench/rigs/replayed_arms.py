"""Many arms in one process: States that are replayed, each arm with a Zenoh session of its own.

    python -m bench.rigs.replayed_arms ENDPOINT FIRST COUNT FILE

FILE holds a Snapshot and States, a line each. The arms are `arm_FIRST` and on, until SIGTERM; then
a line of JSON says what they took.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec.structs import replace

from bench.study.beside import peak_mb
from daemon.protocol.messages import Snapshot, State
from daemon.ros import diagnoses, topics
from daemon.ros.graph import Graph, configuration, session_of
from daemon.ros.messages import diagnostic_array
from daemon.ros.names import Distro, Node
from daemon.ros.services import trigger

DIAGNOSTICS_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Played:
    """What a process of arms took."""

    arms: int
    cpu_s: float
    elapsed_s: float
    longest_gap_s: float  # between two rounds of States
    peak_mb: float


def write(path: Path, snapshot: Snapshot, states: Sequence[State]) -> None:
    """The FILE of these."""
    path.write_bytes(b"\n".join(msgspec.json.encode(one) for one in (snapshot, *states)))


@contextlib.contextmanager
def arms_of(endpoint: str, first: int, count: int, file: Path) -> Iterator[subprocess.Popen[str]]:
    """A process of arms while the context lasts."""
    command = [sys.executable, "-m", "bench.rigs.replayed_arms", endpoint, str(first), str(count)]
    with subprocess.Popen([*command, str(file)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise RuntimeError("the arms do not start")
        try:
            yield process
        finally:
            process.kill()


def played(process: subprocess.Popen[str]) -> Played:
    """End it: what it took."""
    process.terminate()
    said, _ = process.communicate()
    return Played(**json.loads(said))


class ReplayedArm:
    """One arm in the graph."""

    def __init__(self, opened: contextlib.ExitStack, endpoint: str, name: str, file: Path) -> None:
        first, *rest = file.read_bytes().split(b"\n")
        self._snapshot = msgspec.json.decode(first, type=Snapshot)
        self._states = [msgspec.json.decode(line, type=State) for line in rest]
        session = opened.enter_context(session_of(configuration((endpoint,), None)))
        node = Node(0, f"/{name}", "contactd", Distro.JAZZY, str(session.zid()))
        stop = {"stop": trigger(lambda who: (True, "stands"))}
        graph = Graph(session, node, topics.endpoints(node), stop, lambda text: None)
        self._graph = opened.enter_context(graph)
        self._name, self._topics = name, topics.Topics(self._snapshot, name)

    def publish(self, number: int, *, diagnose: bool) -> None:
        """State of this number, as of now."""
        state = self._states[number % len(self._states)]
        state = replace(state, timing=replace(state.timing, wall_s=time.time()))
        for topic, payload in self._topics.of(state):
            self._graph.publishers[topic].put(payload)
        if diagnose:
            found = diagnoses.of(state, self._snapshot.joints, self._name, None)
            payload = diagnostic_array(state.timing.wall_s, found)
            self._graph.publishers["/diagnostics"].put(payload)


def main() -> None:
    """Play until SIGTERM."""
    endpoint, first, count, file = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    with contextlib.ExitStack() as opened:
        arms = [ReplayedArm(opened, endpoint, f"arm_{first + i}", Path(file)) for i in range(count)]
        print("plays", flush=True)
        took = _play(arms, ended)
    print(json.dumps(took), flush=True)


def _play(arms: Sequence[ReplayedArm], ended: threading.Event) -> dict[str, Any]:
    period_s = 0.01
    begun_s, cpu_s, longest_s = time.monotonic(), time.process_time(), 0.0
    last_s, number = begun_s, 0
    while not ended.is_set():
        due = number % round(DIAGNOSTICS_S / period_s) == 0
        for arm in arms:
            arm.publish(number, diagnose=due)
        number += 1
        now_s = time.monotonic()
        longest_s, last_s = max(longest_s, now_s - last_s), now_s
        time.sleep(max(begun_s + number * period_s - now_s, 0.0))
    return {
        "arms": len(arms),
        "cpu_s": time.process_time() - cpu_s,
        "elapsed_s": time.monotonic() - begun_s,
        "longest_gap_s": longest_s,
        "peak_mb": peak_mb(os.getpid()),
    }


if __name__ == "__main__":
    main()
