"""An armed arm in lockstep that is brought to a mode and pushed, on a bus that may lose frames."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import click
import msgspec
import numpy as np

from bench.rigs.faulty_wire import FaultyWire
from bench.rigs.lockstep import DESK_ARM, ROMEO, Rig, lockstep_rig
from daemon.config.load import load_robot
from daemon.config.schema import Configuration, Sinusoid, Trajectory
from daemon.modes.contact_reactions import AfterQuiet
from daemon.modes.table import GUIDED, Event, Mode
from drivers.can.wire import Wire

ARMS: Final = {"romeo": ROMEO, "desk arm": DESK_ARM}
JOINTS: Final = {
    name: len(load_robot(folder).configuration.joints) for name, folder in ARMS.items()
}


def configured(c: Configuration) -> Configuration:
    """All joints move at once, to and fro, and an interrupted trajectory is returned to."""
    waves = {
        name: Sinusoid(amplitude=0.15, frequency_Hz=0.4 + 0.02 * i)
        for i, name in enumerate(c.joint_names)
    }
    return msgspec.structs.replace(
        c,
        trajectory=Trajectory(sinusoids=waves, ramp_s=0.3),
        admittance=msgspec.structs.replace(c.admittance, after_quiet=AfterQuiet.RETURN),
        estimator=msgspec.structs.replace(c.estimator, beside=()),
    )


class Run:
    """An arm that is brought to a mode, and pushed."""

    def __init__(self, rig: Rig, wire: FaultyWire) -> None:
        self.rig, self.wire = rig, wire
        self.n = len(rig.robot.configuration.joints)
        self._sure_ticks = 0
        self._before = rig.mode
        self.resumed_early = False

    def watch(self) -> None:
        """Look at the tick that has ended: quiet ticks that count, and what follows from them."""
        rig = self.rig
        mode, estimate = rig.mode, rig.last.estimate
        quiet_s = rig.tick.controller.quiet.limit_s
        if (
            self._before in GUIDED
            and mode in (Mode.TRACKING, Mode.RETURNING)
            and mode is not self._before
        ):
            needed = round(quiet_s / rig.robot.configuration.period_s) - 1
            returns = self._before is Mode.RETURNING
            self.resumed_early |= not returns and self._sure_ticks < needed
        if estimate is None or np.any(estimate.thresholded):
            self._sure_ticks = 0
        elif estimate.sensing.all():
            self._sure_ticks += 1
        self._before = mode

    def step(self, seconds: float) -> None:
        """Undisturbed."""
        self.rig.run(seconds, self.watch)

    def push(self, joint: int, torque: float) -> None:
        """From now on."""
        self.rig.arm.external_torque[joint] = torque

    def bring_to(self, mode: Mode, joint: int) -> None:
        """Arm, and come to a mode; a guided one by a push on `joint`."""
        rig = self.rig
        rig.enable()
        if mode is not Mode.HOLDING:
            rig.request(Event.START)
        self.step(0.8)
        if reasons := rig.permit():
            raise click.ClickException("; ".join(reasons))
        if mode in GUIDED:
            level = rig.robot.configuration.joints[joint].thresholds.contact
            self.push(joint, 2.0 * level)
            self.step(0.4)
            self.push(joint, 0.0)
            self.step(0.3)
        for _ in range(400):
            if rig.mode is mode:
                return
            self.step(rig.robot.configuration.period_s)
        raise click.ClickException(f"did not come to {mode}: {rig.mode}, {rig.last.cause}")


@contextmanager
def running(arm: str) -> Iterator[Run]:
    """A run of this arm, which can lose frames."""
    wires: list[FaultyWire] = []

    def between(wire: Wire) -> FaultyWire:
        wires.append(FaultyWire(wire))
        return wires[0]

    with lockstep_rig(ARMS[arm], configure=configured, between=between) as rig:
        yield Run(rig, wires[0])
