"""Losses: samples, setpoints or deadlines that go missing, drawn before a run begins."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.rigs.faulty_wire import FaultyWire
from bench.rigs.lockstep import WALL_S, Rig
from daemon.tick.record import Wakeup
from drivers.codec import receive_pdos, transmit_pdos

Mask = NDArray[np.bool_]
What = Literal["samples", "setpoints", "deadlines"]


@dataclass(frozen=True, slots=True)
class Pattern:
    """Ticks that go missing: `lost` of every `of`, a random `share` of all, or bursts of `lost`
    that begin at random every `of` ticks on average."""

    lost: int = 0
    of: int = 0
    share: float = 0.0
    burst: bool = False

    def __str__(self) -> str:
        if self.burst:
            return f"bursts of {self.lost} every {self.of}"
        return f"{self.lost} of {self.of}" if self.of else f"{100 * self.share:g} %"

    def ticks(self, rng: np.random.Generator, count: int) -> Mask:
        """Mask of the ticks (count,) that are lost."""
        if self.share:
            share: Mask = rng.random(count) < self.share
            return share
        if not self.burst:
            periodic: Mask = (np.arange(count) + rng.integers(self.of)) % self.of < self.lost
            return periodic
        lost = np.zeros(count, dtype=np.bool_)
        for begin in np.flatnonzero(rng.random(count) < 1.0 / self.of):
            lost[begin : begin + self.lost] = True
        return lost


@dataclass(frozen=True, slots=True)
class Loss:
    """What goes missing, and of whom: one joint, each joint for itself, or all at once."""

    what: What
    pattern: Pattern
    whose: int | Literal["each", "all"] = "all"

    def __str__(self) -> str:
        whose = f"joint {self.whose + 1}" if isinstance(self.whose, int) else self.whose
        return f"{self.what} {self.pattern} ({whose})"

    def drawn(self, rng: np.random.Generator, count: int, joints: int) -> Mask:
        """Mask (count, joints) of what is lost."""
        if self.whose == "each":
            return np.stack([self.pattern.ticks(rng, count) for _ in range(joints)], axis=1)
        lost = np.zeros((count, joints), dtype=np.bool_)
        which = slice(None) if self.whose == "all" else self.whose
        lost[:, which] = self.pattern.ticks(rng, count).reshape(-1, *[1] * (self.whose == "all"))
        return lost


def lossy_steps(rig: Rig, wire: FaultyWire, loss: Loss, lost: Mask) -> Iterator[Mask]:
    """Step the rig through these losses (count, n); yields what was lost of each step (n,)."""
    drives = rig.robot.configuration.joint_drives
    pdos_of = receive_pdos if loss.what == "setpoints" else transmit_pdos
    pdos = [{pdo.cob_id for pdo in pdos_of(drive)} for drive in drives]
    left_out = 0
    for row in lost:
        if loss.what == "deadlines" and row.all():
            left_out += 1
            continue
        cob_ids = {cob_id for i in np.flatnonzero(row).tolist() for cob_id in pdos[i]}
        wire.lost, wire.unsent = (set(), cob_ids) if loss.what == "setpoints" else (cob_ids, set())
        late_step(rig, left_out)
        left_out = 0
        yield row
    wire.lost, wire.unsent = set(), set()


def late_step(rig: Rig, left_out: int) -> None:
    """One step of the rig, after deadlines that were left out."""
    period_s = rig.robot.configuration.period_s
    if left_out:
        rig.arm.advance(rig.arm.now + left_out * period_s)
        rig.ticks += left_out
    rig.tick.begin(rig.time_s)
    rig.lockstep.pump()
    lateness_s = (left_out + 0.2) * period_s if left_out else 0.0
    rig.tick.finish(
        0.0, Wakeup(lateness_s=lateness_s, left_out=left_out, wall_s=WALL_S + rig.time_s)
    )
    rig.ticks += 1
