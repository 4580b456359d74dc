"""Worker: recordings of both shipped arms, made by the code that it measures, and their replay.

Asked for an `arm` and a `part` ("replay", "decode" or "step"), it answers the CPU time of that
part, `cpu_s`, and the number of `states`. Steps are taken as a replay takes them, on samples that
are ready; to decode is to read the file, and to fill arrays where the code has them.
"""

import importlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from bench.rigs.lockstep import DESK_ARM, ROMEO, Rig, lockstep_rig
from daemon.assembly import build_estimator
from daemon.clients import replay as replaying
from daemon.clients.recorder import read_log, record
from daemon.config.load import parse_configuration
from daemon.modes.table import Event
from daemon.protocol.messages import Snapshot, State
from daemon.service.status import snapshot_of

# Of the code before, too, where acts stand beside the hand.
Push: Final = importlib.import_module("simulator.hand").Push
ARMS: Final = {folder.name: folder for folder in (ROMEO, DESK_ARM)}
PUSHES_APART_S: Final = 6.0


class LockstepClient:
    """A rig in the place of a connection to the daemon: each packet is one tick."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def subscribe(self) -> tuple[Snapshot, Iterator[State]]:
        return snapshot_of(self._rig.robot, self._rig.tick), iter(())

    def packet(self) -> bytes:
        self._rig.step()
        return msgspec.json.encode(self._rig.state())

    def close(self) -> None:
        """Nothing is open."""


def made(path: Path, folder: Path, seconds: float, seed: int) -> Path:
    """A recording in lockstep: enabled and set in motion in it, pushed every six seconds."""
    rng = np.random.default_rng(seed)
    with lockstep_rig(folder) as rig:
        joints = rig.robot.configuration.joint_names
        hand = tuple(
            Push(
                at_s=float(at_s),
                joint=joints[rng.integers(len(joints))],
                torque=float(rng.choice((-1.0, 1.0)) * rng.uniform(1.0, 4.0)),
                duration_s=0.5,
                shape="pulse",
            )
            for at_s in np.arange(3.0, seconds, PUSHES_APART_S)
        )
    with lockstep_rig(
        folder, simulate=lambda s: msgspec.structs.replace(s, seed=seed), hand=hand
    ) as rig:
        rig.run(0.1)
        asked = [(0.2, Event.ENABLE), (1.2, Event.START)]

        def stop() -> bool:
            if asked and rig.time_s >= asked[0][0]:
                rig.request(asked.pop(0)[1])
            return rig.time_s >= seconds

        record(lambda: LockstepClient(rig), path, stop=stop)  # type: ignore[arg-type, return-value]
    return path


@contextmanager
def begin(options: dict[str, Any]) -> Iterator[Callable[[dict[str, Any]], dict[str, Any]]]:
    """options: the `folder` for recordings, how many `seconds` of each arm, and the `seed`."""
    folder = Path(options["folder"])
    paths = {
        arm: made(folder / f"{arm}.mcap", of, options["seconds"], options["seed"])
        for arm, of in ARMS.items()
    }
    parts = {"replay": replayed, "decode": decoded, "step": stepped}

    def answer(request: dict[str, Any]) -> dict[str, Any]:
        states, cpu_s = parts[request["part"]](paths[request["arm"]])
        return {"states": states, "cpu_s": cpu_s}

    yield answer


def replayed(path: Path) -> tuple[int, float]:
    """States and CPU time [s] of a whole replay. Raises AssertionError if it differs."""
    begun = time.process_time()
    result = replaying.replay(path)
    took = time.process_time() - begun
    assert result.identical, result
    assert not result.broken, result
    return result.states, took


def decoded(path: Path) -> tuple[int, float]:
    """The same of decoding alone."""
    states, begun = 0, time.process_time()
    if not hasattr(replaying, "batches"):
        for message in read_log(path):
            states += isinstance(message, State)
        return states, time.process_time() - begun
    snapshot, *_ = read_log(path)
    layout = _layout(snapshot)
    begun = time.process_time()
    for batch in replaying.batches(path):
        if isinstance(batch, list):
            layout.samples(batch)
            layout.recorded(batch)
            states += len(batch)
    return states, time.process_time() - begun


def stepped(path: Path) -> tuple[int, float]:
    """The same of the estimator's steps alone."""
    snapshot, *states = read_log(path)
    assert isinstance(snapshot, Snapshot)
    estimator = build_estimator(_configuration(snapshot), snapshot.urdf)
    estimator.restore(snapshot.memory)
    if hasattr(replaying, "stepped"):
        layout = _layout(snapshot)
        samples = layout.samples([state for state in states if isinstance(state, State)])
        begun = time.process_time()
        replaying.stepped(estimator, samples, (), layout)
        return len(states), time.process_time() - begun
    took = 0.0
    for state in states:
        assert isinstance(state, State)
        current, q = np.array(state.current), np.array(state.link_position)
        theta_dot = np.array(state.motor_velocity)
        theta = None if state.motor_position is None else np.array(state.motor_position)
        fresh = np.array(state.fresh)
        begun = time.process_time()
        dt, time_s = state.interval_s, state.time_s
        estimator.step(current, q, theta_dot, theta, dt, time_s=time_s, fresh=fresh)
        took += time.process_time() - begun
    return len(states), took


def _configuration(snapshot: Snapshot) -> Any:
    return parse_configuration(snapshot.configuration, "the recording", snapshot.identified)


def _layout(snapshot: Any) -> Any:
    from daemon.clients.columns import Layout  # noqa: PLC0415 - the code before has none

    c = _configuration(snapshot)
    return Layout(tuple(c.joint_names), tuple(v.name for v in c.estimator.beside))
