"""Clamps: what presses on what, after an arm has run into something that does not give way.

    python -m bench.clamp [--arm NAME] [--json]

Springs of 40 to 4000 Nm/rad stand in the way of one joint, in lockstep. The arm runs into them at
several speeds, or stands before one and is started; armed and not. The torque is the true one of
the spring, every millisecond. Times count from when the arm first stood after it had noticed: when
the joint's motor first went no further into the clamp. Where two make a clamp, the second is a hand
behind the joint, which begins to press when the arm backs into it.
"""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import click
import msgspec
import numpy as np

from bench.options import help_of
from bench.report import Target, print_report
from bench.rigs.clamps import Clamps, Obstacle
from bench.rigs.lockstep import DESK_ARM, ROMEO, Rig, lockstep_rig
from daemon.config.schema import Configuration, Sinusoid, Trajectory
from daemon.modes.contact_reactions import ContactReaction
from daemon.modes.table import Event, Mode

ARMS = {
    "romeo": (ROMEO, ("LShoulderPitch", "LElbowRoll")),
    "desk arm": (DESK_ARM, ("column", "swing")),
}
STIFFNESS = (40.0, 150.0, 600.0, 4000.0)  # [Nm/rad]
SPEEDS = (0.15, 0.33, 0.9)  # [rad/s]
HANDS = (40.0, 150.0, 600.0)  # [Nm/rad] at the joint, behind it
AMPLITUDE = 0.4  # [rad]
AHEAD = 0.01  # how far before the link an obstacle is put [rad]
BEHIND = 0.003  # and the hand behind it, when it stands
STANDS = 0.02  # [rad/s]
FALLS_AFTER_S, HALF_S, FREE_S = 0.1, 0.5, 1.0
WATCHED_S = 2.5
# Ripple of a torque that only falls [Nm]. Below the contact level it may be anything: there the
# link lies in its gap, against the clamp.
RIPPLE = 0.1
# By how much more than its contact level the arm may press a hand behind it [Nm].
MARGIN = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One clamp and how the arm meets it."""

    arm: str
    joint: str
    stiffness: float
    speed: float
    armed: bool = False
    contact: ContactReaction = ContactReaction.ADMITTANCE  # while it is armed
    started: bool = False  # before it, instead of running into it
    hand: float = 0.0  # stiffness of the hand behind; 0 is none


@dataclass(frozen=True, slots=True, kw_only=True)
class Squeeze:
    """What was measured of a case; torques [Nm], times [s] after the arm first stood."""

    contact: float  # level
    peak: float
    stood: float  # torque when it first stood; nan where it did not
    rise: float  # the largest from 0.1 s on, beyond the contact level
    half_s: float
    free_s: float  # below the contact level for good
    last: float
    behind: float  # peak of the hand behind
    hand: float  # peak of it, less what the clamp hands on to it through the arm
    collided: bool  # a residual reached its collision level
    modes: tuple[str, ...]


def cases(arms: tuple[str, ...] = tuple(ARMS)) -> Iterator[Case]:
    """All of them."""
    for arm in arms:
        for joint in ARMS[arm][1]:
            for stiffness in STIFFNESS:
                usual = Case(arm=arm, joint=joint, stiffness=stiffness, speed=SPEEDS[1])
                for armed in (False, True):
                    for speed in SPEEDS:
                        yield replace(usual, speed=speed, armed=armed)
                    yield replace(usual, armed=armed, started=True)
                yield replace(usual, armed=True, contact=ContactReaction.REPORT)
                for hand in HANDS:
                    yield replace(usual, hand=hand)


def configured(
    c: Configuration, joint: str, speed: float, contact: ContactReaction
) -> Configuration:
    """The robot with a trajectory that swings one joint with this highest speed [rad/s]."""
    wave = Sinusoid(amplitude=AMPLITUDE, frequency_Hz=speed / AMPLITUDE / (2.0 * np.pi))
    trajectory = Trajectory(sinusoids={joint: wave}, ramp_s=0.5)
    reactions = msgspec.structs.replace(c.reactions, contact=contact)
    return msgspec.structs.replace(c, trajectory=trajectory, reactions=reactions)


def meet(rig: Rig, clamps: Clamps, case: Case) -> Obstacle:
    """Let the arm run, and put the clamp in its way; returns it."""
    i = rig.robot.configuration.joint_names.index(case.joint)
    rig.enable()
    rig.run(0.5)
    side = 1
    clamp = clamps.put(i, 0.002, side, case.stiffness) if case.started else None
    rig.request(Event.START)
    rig.run(0.1)
    if case.armed and (reasons := rig.permit("the bench")):
        raise click.ClickException("; ".join(reasons))
    if clamp is None:
        while abs(rig.arm.plant.theta_dot[i]) < 0.93 * case.speed:
            rig.step()
        side = int(np.sign(rig.arm.plant.theta_dot[i]))
        clamp = clamps.put(i, AHEAD, side, case.stiffness)
    return clamp


def measure(case: Case) -> Squeeze:
    """Run one case."""
    folder: Path = ARMS[case.arm][0]
    with lockstep_rig(
        folder, configure=lambda c: configured(c, case.joint, case.speed, case.contact)
    ) as rig:
        clamps = Clamps(rig)
        clamp = meet(rig, clamps, case)
        modes, stood_s, collided = [rig.mode], None, False
        while rig.time_s < 20.0 and (stood_s is None or clamps.trace[-1][0] < stood_s + WATCHED_S):
            if stood_s is not None and rig.mode is Mode.TRACKING:
                break  # it goes on by itself, after the quiet time
            rig.step()
            if rig.mode is not modes[-1]:
                modes.append(rig.mode)
            notices = [notice.contact for notice in rig.last.notices if notice.contact]
            collided = collided or any(one.level == "collision" for one in notices)
            into = clamp.side * float(rig.arm.plant.theta_dot[clamp.joint])
            if stood_s is None and len(modes) > 1 and into <= STANDS:
                stood_s = clamps.trace[-1][0]
                if case.hand:
                    clamps.put(clamp.joint, BEHIND, -clamp.side, case.hand)
        level = rig.robot.configuration.joints[clamp.joint].thresholds.contact
        return squeeze(clamps, stood_s, level, collided, tuple(modes))


def squeeze(
    clamps: Clamps,
    stood_s: float | None,
    contact: float,
    collided: bool,
    modes: tuple[str, ...],
) -> Squeeze:
    """Figures of the torques over time."""
    time_s = np.array([t for t, _ in clamps.trace]) - (np.inf if stood_s is None else stood_s)
    torque = np.array([felt[0] for _, felt in clamps.trace])
    pressed = [felt[1] - felt[0] for _, felt in clamps.trace if len(felt) > 1]
    after = torque[time_s >= 0.0]
    late = np.maximum(torque[time_s >= FALLS_AFTER_S], contact)
    stood = float(after[0]) if after.size else np.nan

    def last_above(level: float) -> float:
        above = time_s[(torque >= level) & (time_s >= 0.0)]
        return float(above[-1]) if above.size else 0.0

    return Squeeze(
        contact=contact,
        peak=float(torque.max()),
        stood=stood,
        rise=float((late - np.minimum.accumulate(late)).max()) if late.size else np.nan,
        half_s=last_above(0.5 * stood),
        free_s=last_above(contact),
        last=float(torque[-1]),
        behind=max((felt[1] for _, felt in clamps.trace if len(felt) > 1), default=0.0),
        hand=max(pressed, default=0.0),
        collided=collided,
        modes=modes,
    )


def line(case: Case, found: Squeeze) -> str:
    """One row of the printed table."""
    how = f"hand {case.hand:g}" if case.hand else "started" if case.started else "moving"
    return (
        f"{case.arm:8} {case.joint:14} {case.stiffness:5.0f} {case.speed:4.2f} "
        f"{case.contact if case.armed else '-':10} {how:8} {'x' if found.collided else ' '} "
        f"{found.peak:6.2f} {found.stood:6.2f} "
        f"{found.rise:5.2f} {found.half_s:5.2f} {found.free_s:5.2f} {found.last:5.2f} "
        f"{found.hand:5.2f}  {' '.join(found.modes)}"
    )


def targets_of(rows: list[tuple[Case, Squeeze]]) -> list[Target]:
    """Held against limits; a person behind the arm is another matter."""
    alone = [found for case, found in rows if not case.hand and found.collided]
    let_go = [found for found in alone if Mode.RELEASING in found.modes]
    pressed = [found.hand - found.contact for case, found in rows if case.hand]
    return [
        Target(
            "clamps before which the arm never stood",
            sum(math.isnan(f.stood) for f in alone),
            0,
            "",
            "lower",
        ),
        Target(
            "rise from 0.1 s on, beyond the contact level, of what is let go",
            max(f.rise for f in let_go),
            RIPPLE,
            "Nm",
            "lower",
        ),
        Target("torque below half within", max(f.half_s for f in alone), HALF_S, "s", "lower"),
        Target(
            "below the contact level within", max(f.free_s for f in alone), FREE_S, "s", "lower"
        ),
        Target(
            "pressed on a hand behind, beyond the contact level",
            max(pressed, default=0.0),
            MARGIN,
            "Nm",
            "lower",
        ),
    ]


@click.command(help=help_of(__doc__))
@click.option("--arm", "arms", multiple=True, type=click.Choice(list(ARMS)), help="Only this one.")
@click.option("--json", "as_json", is_flag=True)
def main(arms: tuple[str, ...], as_json: bool) -> None:
    if not as_json:
        click.echo(
            f"{'arm':8} {'joint':14} {'Nm/r':>5} r/s  {'armed':10} {'':6} hit "
            f"{'peak':>6} {'stood':>6} "
            f"{'rise':>5} {'half':>5} {'free':>5} {'last':>5} {'hand':>5}"
        )
    rows = []
    for case in cases(arms or tuple(ARMS)):
        found = measure(case)
        rows.append((case, found))
        if not as_json:
            click.echo(line(case, found))
    data = {"rows": [{**asdict(case), **asdict(found)} for case, found in rows]}
    print_report("clamp", 1, targets_of(rows), data, as_json=as_json)


if __name__ == "__main__":
    main()
