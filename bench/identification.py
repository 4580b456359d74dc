"""How well friction, rotor inertia and half-gap of arms that nobody knows are found.

    python -m bench.identification [--arms N] [--seconds S] [--seed N] [--json]

Every arm has friction up to 1.5 times more or less than the nominal one, half-gaps 1.3, rotors
1.25, torque constants 1.02, masses and centres of mass 1.03 times. All move along one excitation;
their sensors report it with the usual noise, with four times as much, and without the drives'
filter of the current. Then a hand leads every link from border to border while the motors stand.
A picture goes to bench/out/identification.png.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np
from numpy.typing import NDArray

from bench.figures import Target, print_report
from bench.fleet import Scatter, SoftHand, random_arm, record_fleet
from bench.lockstep import ROMEO
from daemon.assembly import build_transmission
from daemon.commands.simulated_robot import describe, read_simulation
from daemon.config.load import load_robot
from estimator.identification.excitation import Bounds, fourier_within, trajectory
from estimator.identification.friction import Verdict, identify_friction
from estimator.identification.gap import identify_gap
from estimator.identification.log import MotionLog
from estimator.model import Model
from simulator.description import Mismatch, SimulationSettings
from simulator.mismatch import PlantParameters, true_parameters

Vector = NDArray[np.float64]
OUT = Path(__file__).parent / "out"
EXACT = Mismatch(
    mass=0, center_of_mass=0, friction=0, torque_constant=0, half_gap=0, rotor_inertia=0
)
SENSORS = {
    "usual noise": {},
    "four times the noise": {"velocity_noise": 0.004, "current_noise_permille": 8.0},
    "unfiltered current": {"current_filter_ms": 0.0},
}
COEFFICIENTS = ("K_theta_s", "K_theta_v", "B")


class Study:
    """The nominal arm, a fleet that differs from it, and what sensors saw of the fleet."""

    def __init__(self, arms: int, seconds: float, seed: int) -> None:
        robot = load_robot(ROMEO)
        self.c = c = robot.configuration
        self.model = Model(robot.urdf, c.joint_names)
        self.transmission = build_transmission(c)
        self.max_current = np.array([j.wiring.max_current_A for j in c.joints])
        self.description = describe(robot, read_simulation(robot))
        self.settings = SimulationSettings(mismatch=EXACT, seed=seed)
        rng = np.random.default_rng(seed)
        nominal = true_parameters(self.description, self.settings)
        self.arms = [random_arm(nominal, Scatter(), self.settings, rng) for _ in range(arms)]
        self.seconds = seconds

    def excited(self) -> dict[str, list[MotionLog]]:
        """Logs of every arm, by sensors."""
        rows = [
            (j.limits.lower, j.limits.upper, j.limits.velocity, j.limits.acceleration)
            for j in self.c.joints
        ]
        bounds = Bounds(*np.array(rows).T)
        motion = fourier_within(bounds.shrunk(0.7), self.model, np.random.default_rng(1))
        start = motion.at(np.zeros(1))[0][0]
        path = trajectory(motion, start, bounds, self.seconds, self.c.period_s)
        speed = np.gradient(path, self.c.period_s, axis=0)

        def reference(t: float) -> tuple[Vector, Vector]:
            k = min(round(t / self.c.period_s), len(path) - 1)
            return path[k], speed[k]

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
            self.description,
            self.arms,
            lambda t: still,
            17.0,
            settings,
            push=hand,
            motors_only=True,
        )[0]

    def friction_errors(self, log: MotionLog, arm: PlantParameters, delay_ms: float) -> Vector:
        """Relative errors (3, n) of COEFFICIENTS; NaN where the verdict keeps the old values."""
        settings = msgspec.structs.replace(self.c.estimator, current_delay_ms=delay_ms)
        known = replace(self.transmission, half_gap=arm.half_gap)
        fits, _ = identify_friction(log, self.model, known, settings, self.max_current)
        truth = [
            arm.coulomb.reshape(2, -1).sum(axis=0),
            arm.viscous.reshape(2, -1).sum(axis=0),
            arm.rotor_inertia,
        ]
        errors = np.array([[f.values.get(c, np.nan) for f in fits] for c in COEFFICIENTS]) / truth
        good = np.array([fit.verdict is Verdict.GOOD for fit in fits])
        return np.where(good, errors - 1.0, np.nan)


def summary(errors: Vector) -> dict[str, list[float]]:
    """Median and 95th percentile of |error| per joint [%], and the share without an answer."""
    size = 100.0 * np.abs(errors)
    return {
        "median": np.nanmedian(size, axis=0).round(1).tolist(),
        "p95": np.nanpercentile(size, 95.0, axis=0).round(1).tolist(),
        "unanswered": np.isnan(size).mean(axis=0).round(3).tolist(),
    }


def plot(errors: dict[str, Vector], gaps: Vector, joints: list[str]) -> Path:
    """Errors per joint and coefficient, one box for each case."""
    import matplotlib as mpl  # noqa: PLC0415 - slow, and only here

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(4, 1, figsize=(10, 13), layout="constrained")
    for k, (axis, name) in enumerate(zip(axes[:3], COEFFICIENTS, strict=True)):
        for shift, (case, values) in enumerate(errors.items()):
            rows = [100 * v[~np.isnan(v)] for v in values[:, k].T]
            at = np.arange(len(joints)) + 0.2 * (shift - 1.5)
            box = axis.boxplot(rows, positions=at, widths=0.15, showfliers=False,
                               patch_artist=True, manage_ticks=False)  # fmt: skip
            for patch in box["boxes"]:
                patch.set_facecolor(f"C{shift}")
            axis.plot([], [], color=f"C{shift}", label=case)
        axis.axhline(0.0, color="k", lw=0.5)
        axis.set(ylabel=f"error of {name} [%]", xticks=range(len(joints)), xticklabels=joints)
    axes[0].legend(fontsize=8)
    axes[3].boxplot([1e3 * g[~np.isnan(g)] for g in gaps.T], tick_labels=joints)
    axes[3].set_ylabel("error of alpha [mrad]")
    OUT.mkdir(exist_ok=True)
    path = OUT / "identification.png"
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


@click.command(help=__doc__)
@click.option("--arms", default=50, show_default=True)
@click.option("--seconds", default=20.0, show_default=True)
@click.option("--seed", default=1, show_default=True)
@click.option("--json", "as_json", is_flag=True)
def main(arms: int, seconds: float, seed: int, as_json: bool) -> None:
    study = Study(arms, seconds, seed)
    click.echo(f"{arms} arms move for {seconds:g} s", err=True)
    logs = study.excited()
    cases = [(name, seconds) for name in SENSORS]
    cases.insert(0, ("usual noise", seconds / 2))
    errors: dict[str, Vector] = {}
    with click.progressbar(length=len(cases) * arms, label="fits", file=sys.stderr) as bar:
        for sensors, length in cases:
            rows = slice(0, round(length / study.c.period_s))
            delay = 0.0 if sensors == "unfiltered current" else 3.0
            of_arms = []
            for log, arm in zip(logs[sensors], study.arms, strict=True):
                of_arms.append(study.friction_errors(log.select(rows), arm, delay))
                bar.update(1)
            errors[f"{sensors}, {length:g} s"] = np.array(of_arms)
    click.echo("a hand moves their links", err=True)
    n = len(study.c.joints)
    found = np.array(
        [[identify_gap(log, i, 1.0).half_gap for i in range(n)] for log in study.handled()]
    )
    gaps = found - np.array([arm.half_gap for arm in study.arms])
    names = study.c.joint_names
    picture = plot(errors, gaps, names)
    full = errors[f"usual noise, {seconds:g} s"]

    def worst(k: int) -> float:
        return float(np.nanpercentile(100 * np.abs(full[:, k]), 95.0, axis=0).max())

    def middle(k: int) -> float:
        return float(np.nanmedian(100 * np.abs(full[:, k]), axis=0).max())

    targets = [
        Target("Coulomb, 95 % of arms, worst joint", worst(0), 10, "%", "lower"),
        Target("viscous, 95 % of arms, worst joint", worst(1), 15, "%", "lower"),
        Target("rotor inertia, median arm, worst joint", middle(2), 10, "%", "lower"),
        Target("rotor inertia, 95 % of arms, worst joint", worst(2), 10, "%", "lower"),
        Target("half-gap, 95 % of answers", float(np.nanpercentile(1e3 * np.abs(gaps), 95)), 0.5,
               "mrad", "lower"),
        Target("half-gaps without an answer", float(np.isnan(gaps).mean()) * 100, 5, "%", "lower"),
    ]  # fmt: skip
    data: dict[str, Any] = {
        "joints": names,
        "arms": arms,
        "errors_percent": {
            case: {c: summary(e[:, k]) for k, c in enumerate(COEFFICIENTS)}
            for case, e in errors.items()
        },
        "half_gap_mrad": (1e3 * np.nanmedian(np.abs(gaps), axis=0)).round(3).tolist(),
        "picture": str(picture.relative_to(OUT.parent.parent)),
    }
    if not as_json:
        for case, by_coefficient in data["errors_percent"].items():
            click.echo(f"\n{case}: |error| of {arms} arms per joint [%], median and 95 %")
            for name, one in by_coefficient.items():
                pairs = zip(one["median"], one["p95"], strict=True)
                click.echo(f"  {name:10}" + "".join(f"{m:6.1f} {p:5.1f}" for m, p in pairs))
        click.echo(f"\n{data['picture']}")
    print_report("identification", seed, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
