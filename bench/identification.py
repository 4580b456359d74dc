"""Errors of the identified friction, rotor inertia and half-gap, over arms that are not the model.

    python -m bench.identification [--arms N] [--seconds S] [--jobs N] [--seed N] [--json]

Every arm has friction up to 1.5 times more or less than the nominal one, half-gaps 1.3, rotors
1.25, torque constants 1.02, masses and centres of mass 1.03 times. All move along one excitation;
their sensors report it with and without the drives' filter of the current. Then a hand leads every
link from border to border while the motors stand. Simulated without a bus; an arm takes some ten
seconds of CPU time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import click
import msgspec
import numpy as np

from bench.options import JOBS, SEED, command
from bench.report import Target, print_report, summary
from bench.rigs.arm_batch import Scatter, SoftHand, record_fleet
from bench.rigs.lockstep import ROMEO
from bench.study.masses import Fleet, along
from bench.study.monte_carlo import spread
from common.arrays import Vector
from daemon.assembly import build_transmission
from daemon.config.load import load_robot
from identification.excitation import fourier_within, trajectory
from identification.friction import identify_friction
from identification.friction_verdict import Verdict
from identification.gap import identify_gap
from identification.motion_log import MotionLog
from programs.identify.motions import bounds_of
from simulator.mismatch import PlantParameters

TOGETHER = 5  # Arms that one process simulates at once: few enough to see how far it is
HAND_S = 17.0
FILTER_MS = 3.0
SENSORS = {"usual": {"current_filter_ms": FILTER_MS}, "unfiltered": {"current_filter_ms": 0.0}}
SUMS = ("K_theta_s", "K_theta_v", "B")  # Of motor and link together, and the rotor
COEFFICIENTS = (*SUMS, "K_q_s", "K_q_v")


@dataclass(frozen=True, slots=True)
class Job:
    """Some of the arms."""

    arms: int
    seconds: float
    seed: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Found:
    """Relative errors of COEFFICIENTS by sensors, (arms, 5, n), NaN without an answer; of how many
    joints the rotor was trusted, by sensors; half-gaps found (NaN likewise) and true, (arms, n)."""

    job: Job
    errors: dict[str, Vector]
    trusted: dict[str, int]
    half_gap: Vector
    true_half_gap: Vector


class Study(Fleet):
    """The nominal arm, some that differ from it, and what sensors saw of them."""

    def __init__(self, job: Job) -> None:
        super().__init__(job.arms, job.seed, Scatter())
        self.transmission = build_transmission(self.c)
        self.seconds = job.seconds

    def excited(self) -> dict[str, list[MotionLog]]:
        """Logs of every arm, by sensors."""
        bounds, period_s = bounds_of(self.c), self.c.period_s
        motion = fourier_within(bounds.shrunk(0.7), self.model, np.random.default_rng(1))
        start = motion.at(np.zeros(1))[0][0]
        reference = along(trajectory(motion, start, bounds, self.seconds, period_s), period_s)
        sensors = [msgspec.structs.replace(self.settings, **s) for s in SENSORS.values()]
        logs = record_fleet(
            self.description, self.arms, reference, self.seconds, sensors[0], sensors[1:]
        )
        return dict(zip(SENSORS, logs, strict=True))

    def handled(self) -> list[MotionLog]:
        """Logs of a hand at every link, the motors' velocity 1 mrad/s off."""
        settings = msgspec.structs.replace(self.settings, velocity_bias=0.001)
        q0 = np.array([joint.initial_position for joint in self.description.joints])
        hand = SoftHand(self.arms, q0, self.model.gravity(q0), settings.step_s)
        still = (q0, np.zeros_like(q0))
        return record_fleet(
            self.description, self.arms, lambda t: still, HAND_S, settings, push=hand,
            motors_only=True,
        )[0]  # fmt: skip

    def friction_errors(
        self, log: MotionLog, arm: PlantParameters, delay_ms: float
    ) -> tuple[Vector, int]:
        """Relative errors (5, n) of COEFFICIENTS, NaN where the old values stay, and of how many
        joints the rotor is trusted."""
        settings = msgspec.structs.replace(self.c.estimator, current_delay_ms=delay_ms)
        known = replace(self.transmission, half_gap=arm.half_gap)
        fits, _ = identify_friction(log, self.model, known, settings, self.max_current)
        n, coulomb, viscous = len(fits), arm.coulomb, arm.viscous
        truth = np.array(
            [
                *(coulomb[:n] + coulomb[n:], viscous[:n] + viscous[n:], arm.rotor_inertia),
                *(coulomb[:n], viscous[:n]),
            ]
        )
        found = np.full_like(truth, np.nan)
        for i, fit in enumerate(fits):
            if fit.verdict is Verdict.GOOD:
                alone = [fit.link_friction(name) for name in COEFFICIENTS[len(SUMS) :]]
                values = [*(fit.values[name] for name in SUMS), *alone]
                found[:, i] = [np.nan if value is None else value for value in values]
        return found / truth - 1.0, sum(fit.rotor_trusted for fit in fits)

    def half_gaps(self, log: MotionLog) -> list[float]:
        """Half-gap of every joint [rad], NaN without an answer."""
        constants = self.transmission.torque_constant.tolist()
        return [identify_gap(log, i, constant).half_gap for i, constant in enumerate(constants)]


def examine(job: Job) -> Found:
    """Simulate some arms, and identify them."""
    study = Study(job)
    logs = study.excited()
    errors, trusted = {}, {}
    for name, sensors in SENSORS.items():
        fitted = [
            study.friction_errors(log, arm, sensors["current_filter_ms"])
            for log, arm in zip(logs[name], study.arms, strict=True)
        ]
        errors[name] = np.array([of_arm for of_arm, _ in fitted])
        trusted[name] = sum(joints for _, joints in fitted)
    half_gap = np.array([study.half_gaps(log) for log in study.handled()])
    return Found(job, errors, trusted, half_gap, np.array([arm.half_gap for arm in study.arms]))


def joined(parts: Sequence[Found]) -> Found:
    """All arms, in an order that does not depend on who was faster."""
    parts = sorted(parts, key=lambda part: part.job.seed)
    first = parts[0]
    return Found(
        job=replace(first.job, arms=sum(part.job.arms for part in parts)),
        errors={case: np.concatenate([part.errors[case] for part in parts])
                for case in first.errors},
        trusted={case: sum(part.trusted[case] for part in parts) for case in first.trusted},
        half_gap=np.concatenate([part.half_gap for part in parts]),
        true_half_gap=np.concatenate([part.true_half_gap for part in parts]),
    )  # fmt: skip


def targets(found: Found) -> list[Target]:
    """Targets of the project."""
    size = 100.0 * np.abs(found.errors["usual"])

    def worst(coefficient: str) -> float:
        k = COEFFICIENTS.index(coefficient)
        return float(np.nanpercentile(size[:, k], 95.0, axis=0).max())

    allowed = np.maximum(0.05 * found.true_half_gap, 0.0005)
    share = np.abs(found.half_gap - found.true_half_gap) / allowed
    sums = size[:, : len(SUMS)]
    return [
        Target("Coulomb, 95 % of arms, worst joint", worst("K_theta_s"), 10, "%"),
        Target("viscous, 95 % of arms, worst joint", worst("K_theta_v"), 15, "%"),
        Target("rotor inertia, 95 % of arms, worst joint", worst("B"), 10, "%"),
        Target("joints without an answer, friction", 100.0 * float(np.isnan(sums).mean()), 2, "%"),
        Target("rotors trusted though the current is unfiltered", found.trusted["unfiltered"], 0),
        Target("error of alpha over 5 % or 0.5 mrad, 95 % of answers",
               float(np.nanpercentile(share, 95.0)), 1),
        Target("joints without an answer, alpha", 100.0 * float(np.isnan(share).mean()), 5, "%"),
    ]  # fmt: skip


@command(__doc__)
@click.option("--arms", default=50)
@click.option("--seconds", default=20.0)
@JOBS
@SEED
def main(arms: int, seconds: float, processes: int, seed: int, as_json: bool) -> None:
    todo = [
        Job(min(TOGETHER, arms - first), seconds, (seed, first))
        for first in range(0, arms, TOGETHER)
    ]
    title = f"{arms} arms, {TOGETHER} at a time"
    found = joined(list(spread(examine, todo, processes, title)))
    names = load_robot(ROMEO).configuration.joint_names
    data: dict[str, Any] = {
        "joints": names,
        "arms": arms,
        "errors_percent": {
            case: {c: summary(100.0 * e[:, k]) for k, c in enumerate(COEFFICIENTS)}
            for case, e in found.errors.items()
        },
        "half_gap_mrad": summary(1e3 * (found.half_gap - found.true_half_gap)),
    }
    print_report("identification", seed, targets(found), data, as_json=as_json)


if __name__ == "__main__":
    main()
