"""Romeo's arm from zero to armed without a hand: how true what is identified is, and what its
residuals are by it."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from bench.report import Target
from bench.rigs.all_joints import MOTION, moving
from bench.rigs.lockstep import lockstep_rig
from bench.rigs.person import CommissionedArm, Person, Written, poor_guesses
from bench.study.commissioned import Show, friction_values, judged, true_friction
from common.arrays import Matrix, Vector
from daemon.config.load import load_robot
from daemon.modes.table import Event
from simulator.description import SimulationSettings

MOTIONS, COMPARED_S = 3, 20.0  # without contact, on which residuals are compared
SIZES = ("largest", "rms", "largest beyond the raise near rest")


def motion(turn: int) -> dict[str, tuple[float, float]]:
    """Motion of all joints, its frequencies dealt out anew and 0.6 rad/s nowhere exceeded."""
    frequencies = np.roll([f for _, f in MOTION.values()], turn).tolist()
    return {
        name: (min(amplitude, 0.6 / (2.0 * np.pi * frequency)), frequency)
        for (name, (amplitude, _)), frequency in zip(MOTION.items(), frequencies, strict=True)
    }


def residuals(folder: Path, truth: Path, seed: int) -> Matrix:
    """Largest, root mean square, and largest beyond what thresholds are raised by near rest: |r| of
    every joint [Nm] over contact-free motions of all, (3, n)."""
    sizes, beyond = [], []
    for turn in range(MOTIONS):
        with lockstep_rig(
            folder,
            truth=truth,
            configure=moving(motion(turn)),
            simulate=lambda s: msgspec.structs.replace(s, seed=seed),
        ) as rig:
            rig.enable()
            rig.run(1.0)
            rig.request(Event.START)
            states = rig.states(COMPARED_S)
        r = np.abs([state.residual for state in states])
        threshold = np.array([state.threshold for state in states])
        sizes.append(r)
        beyond.append(np.maximum(r - (threshold - threshold.min(axis=0)), 0.0))
    r = np.concatenate(sizes)
    return np.array(
        [r.max(axis=0), np.sqrt(np.square(r).mean(axis=0)), np.concatenate(beyond).max(axis=0)]
    )


def inertias_of_the_model(settings: SimulationSettings) -> SimulationSettings:
    """Leave masses as in the model; friction, gaps and rotors stay as wrong as they are."""
    mismatch = msgspec.structs.replace(settings.mismatch, mass=0.0, center_of_mass=0.0)
    return msgspec.structs.replace(settings, mismatch=mismatch)


def unfiltered(settings: SimulationSettings) -> SimulationSettings:
    """Make drives report their current as they sample it."""
    return msgspec.structs.replace(settings, current_filter_ms=0.0)


def no_delay(written: Written) -> None:
    """Change a configuration to that of drives that do not filter their current."""
    poor_guesses(written)
    written["estimator"]["current_delay_ms"] = 0.0


def of_gaps(arm: CommissionedArm) -> tuple[float, list[str]]:
    """Worst error of alpha over what is allowed (5 %, or 0.5 mrad), and the joints that rightly
    have no dead zone."""
    assert arm.true is not None
    found = np.array([j.gap.half_gap if j.gap else np.nan for j in arm.found()])
    true = arm.true.half_gap
    allowed = np.maximum(0.05 * true, 0.0005)
    share = np.abs(found - true) / allowed
    rigid = [name for name, f, t in zip(arm.joints, found, true, strict=True) if f == t == 0.0]
    return float(np.where(np.isnan(share), np.inf, share).max()), rigid


def of_friction(arm: CommissionedArm) -> dict[str, Vector]:
    """Errors of what was found [%], per joint; infinite where nothing was."""
    found = np.array([list(friction_values(joint).values()) for joint in arm.found()]).T
    errors = 100.0 * np.abs(found[:3] / np.array([*true_friction(arm).values()]) - 1.0)
    errors = np.where(np.isnan(errors), np.inf, errors)
    return dict(zip(("coulomb", "viscous", "B"), errors, strict=True)) | {"r2": found[3]}


def romeo(folder: Path, seed: int, show: Show) -> tuple[list[Target], dict[str, Any]]:
    """Commission it; targets of the project, and numbers behind them."""
    person = Person(folder, seed, show)
    arm = person.arm
    went = person.from_zero_to_armed()
    gap_share, rigid = of_gaps(arm)
    errors, found = of_friction(arm), arm.found()
    by_identified = residuals(arm.folder, arm.truth, seed)
    by_hand = residuals(arm.truth, arm.truth, seed)
    exact = of_friction(
        person.friction_beside("the model's inertias", 60, simulate=inertias_of_the_model)
    )
    raw = person.friction_beside("unfiltered", 20, change=no_delay, simulate=unfiltered)
    trusted = sum(1 for j in raw.found() if j.friction and j.friction.rotor_inertia is not None)
    ratios = (by_identified / by_hand).max(axis=1).tolist()
    levels = [joint.thresholds.contact for joint in load_robot(arm.truth).configuration.joints]
    # Some hundredths of a newton metre, as by hand: what counts is how far from a contact they are.
    beyond = float((by_identified[2] / levels).max())
    targets, data = judged("romeo", person, went)
    targets += [
        Target("error of alpha over 5 % or 0.5 mrad, worst joint", gap_share, 1),
        Target("joints rightly without a dead zone", len(rigid), 2, "", "higher"),
        Target("Coulomb friction of motor and link, worst joint", errors["coulomb"].max(), 10, "%"),
        Target("viscous friction of motor and link, worst joint", errors["viscous"].max(), 15, "%"),
        Target("rotor inertia, worst joint", errors["B"].max(), 10, "%"),
        Target("rotors trusted though the current is unfiltered", trusted, 0),
        Target("R2 on held-out motion, inertias of the model, worst joint", exact["r2"].min(), 0.98,
               better="higher"),
        *[Target(f"{name} contact-free |r|, identified over hand-written, worst joint", ratio, 1)
          for name, ratio in zip(SIZES[:2], ratios, strict=False)],
        Target(f"{SIZES[2]}, of the hand-written contact level, worst joint", beyond, 0.25),
    ]  # fmt: skip
    data |= {
        "rigid": rigid,
        "errors_percent": {k: v.round(2).tolist() for k, v in errors.items() if k != "r2"},
        "r2": errors["r2"].tolist(),
        "r2_inertias_of_the_model": exact["r2"].tolist(),
        "stiction": [j.friction.friction.stiction if j.friction else None for j in found],
        "residual_Nm": {
            size: {"identified": mine.round(3).tolist(), "by hand": hand.round(3).tolist()}
            for size, mine, hand in zip(SIZES, by_identified, by_hand, strict=True)
        },
    }
    return targets, data
