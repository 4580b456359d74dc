"""Ten minutes of an armed arm at work, on gears that are not the model's: what made it yield.

    python -m bench.only_the_hand [--minutes N] [--presliding X] [--seed N] [--json]

The Romeo arm in lockstep, the whole program on its bus, armed: moves from point to point with rests
between. Friction is Dahl's with a pre-sliding of 0.2 mrad, 40 % off, and drifts by 20 % in ten
minutes. Every 40 s a hand takes the arm by a joint for a second; then the arm goes back and on. A
yield or a contact belongs to the hand if it begins while the hand is there, or in the quarter of a
second after it let go, in which the residual fades.
"""

import math
import re
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import click
import msgspec
import numpy as np

from bench.options import SEED, command
from bench.report import Target, print_report
from bench.rigs.lockstep import ROMEO, Rig, lockstep_rig
from bench.study import courses
from bench.study.world import DRIFT, DRIFT_PERIOD_S
from daemon.config.load import load_robot
from daemon.modes.table import Event, Mode
from programs.simulate.simulated_robot import read_simulation
from simulator.description import Mismatch, SimulationSettings

EVERY_S: Final = 40.0
PUSH_S: Final = 1.0
FADES_S: Final = 0.25
JOINTS: Final = (0, 1, 2, 3)
TIMES: Final = 3.0  # of the configured level, beyond the static friction
REST_S: Final = (0.3, 4.0)


@dataclass
class Day:
    """What happened; the arm is watched tick by tick."""

    pushes: int = 0
    yielded_to: int = 0  # pushes that made it yield
    yields: list[float] = field(default_factory=list)  # times [s], without a hand
    contacts: list[str] = field(default_factory=list)  # without a hand
    faults: int = 0
    tracked_s: float = 0.0


def folder_with(minutes: float, seed: int, folder: Path) -> Path:
    """A copy of the Romeo arm whose trajectory is a file of moves from point to point."""
    robot = load_robot(ROMEO)
    room, rng = courses.Room.of(robot.configuration), np.random.default_rng((seed, 50))
    initial = read_simulation(robot).initial_position
    start = np.array([initial[name] for name in robot.configuration.joint_names])
    home = np.clip(start, room.lower, room.upper)
    course = courses.point_to_point(room, home, 60.0 * minutes, rng)
    path = courses.folder_with(course, robot, folder) / "config.yaml"
    text, back = re.subn("after_quiet: resume ", "after_quiet: return ", path.read_text())
    assert back == 1
    path.write_text(text)
    return folder


def work(rig: Rig, minutes: float, seed: int) -> Day:
    """Let the arm work and the hand take it now and then."""
    day, rng = Day(), np.random.default_rng((seed, 51))
    c, period_s = rig.robot.configuration, rig.robot.configuration.period_s
    phase = rng.uniform(0.0, 2.0 * math.pi, len(c.joints))
    there_until, hand, before, begun = -1.0, False, rig.mode, False
    for k in range(round(60.0 * minutes / period_s)):
        t = k * period_s
        if k % 100 == 0:
            drift = DRIFT * np.sin(2.0 * math.pi * t / DRIFT_PERIOD_S + phase)
            rig.arm.plant.scale_friction(1.0 + drift)
        if k % round(EVERY_S / period_s) == 0 and k > 0:
            i = int(rng.choice(JOINTS))
            joint = c.joints[i]
            stuck = joint.friction.motor_coulomb + joint.friction.link_coulomb
            size = min(
                TIMES * joint.thresholds.contact + 2.0 * stuck,
                0.7 * joint.torque_constant * joint.wiring.max_current_A,
            )
            rig.arm.external_torque[i] = size * rng.choice((-1.0, 1.0))
            day.pushes += 1
            there_until, hand, begun = t + PUSH_S, True, False
        if hand and t > there_until:
            rig.arm.external_torque[:] = 0.0
            hand = False
        rig.step()
        by_hand = t <= there_until + FADES_S
        if rig.mode is Mode.ADMITTANCE and before is not Mode.ADMITTANCE:
            if by_hand:
                day.yielded_to += not begun
                begun = True
            else:
                day.yields.append(round(t, 2))
        day.contacts += [
            f"{t:.2f} s: {one.joint} {one.torque:+.2f} of {one.threshold:.2f} Nm"
            for one in rig.estimate.contacts
            if not by_hand and rig.mode is not Mode.ADMITTANCE
        ]
        if rig.mode in (Mode.FAULTED, Mode.OFF):
            day.faults += 1
            return day
        if k % 50 == 0:
            _go_on(rig)
        before = rig.mode
        day.tracked_s += period_s * (before is Mode.TRACKING)
    return day


def _go_on(rig: Rig) -> None:
    """Arm again where the permission ended, and start again where the trajectory did."""
    if not rig.tick.controller.machine.armed:
        rig.permit()
    if rig.mode is Mode.HOLDING:
        rig.tick.controller.request(Event.START, "the bench", rig.time_s)


def run(minutes: float, presliding: float, seed: int) -> Day:
    """Simulate the day."""

    def simulate(s: SimulationSettings) -> SimulationSettings:
        nothing = dict.fromkeys(Mismatch.__struct_fields__, 0.0)
        mismatch = Mismatch(**nothing | {"mass": 3.0, "friction": 40.0, "half_gap": 5.0})
        return msgspec.structs.replace(
            s, seed=seed, friction="dahl", presliding=presliding, mismatch=mismatch
        )

    with tempfile.TemporaryDirectory() as place:
        folder = folder_with(minutes, seed, Path(place) / "arm")
        with lockstep_rig(folder, simulate=simulate) as rig:
            rig.enable()
            rig.run(1.0)
            rig.request(Event.START)
            rig.run(5.0)
            refused = rig.permit()
            assert not refused, refused
            return work(rig, minutes, seed)


def targets(day: Day) -> list[Target]:
    """Only the hand ever made it yield."""
    return [
        Target("yields while nobody was there", len(day.yields), 0),
        Target("contacts that nobody made", len(day.contacts), 0),
        Target("hands that it did not yield to", day.pushes - day.yielded_to, 0),
        Target("faults", day.faults, 0),
    ]


@command(__doc__)
@click.option("--minutes", type=click.FloatRange(0.5, 60.0), default=10.0)
@click.option("--presliding", type=click.FloatRange(1e-4, 2e-3), default=2e-4, help="[rad]")
@SEED
def main(minutes: float, presliding: float, seed: int, as_json: bool) -> None:
    day = run(minutes, presliding, seed)
    data: dict[str, Any] = {"minutes": minutes, "presliding": presliding, **vars(day)}
    print_report("only_the_hand", seed, targets(day), data, as_json=as_json)


if __name__ == "__main__":
    main()
