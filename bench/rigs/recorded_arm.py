"""Recordings of a simulated arm in lockstep: set in motion, and pushed every six seconds."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.config.load import load_robot
from daemon.modes.table import Event
from daemon.protocol.state import Snapshot, State
from daemon.service.status import snapshot_of
from programs.clients.recorder import record
from simulator.hand_script import Push

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
    joints = load_robot(folder).configuration.joint_names
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
