"""Contact-free motion of all joints in lockstep: what each residual raises by itself.

    python -m bench.contact_free [--seconds S] [--seed N] [--json]

The plant differs from the model by the default mismatch of `simulation.yaml`; thresholds are the
paper's, raised near rest. Every variant of the residual runs on the same samples. At the end, how
fast lockstep is by CPU time, as a multiple of real time, and in turns with the commit before the
estimator's compiled kernel.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np

from arrays import Vector
from bench.options import SEED, help_of
from bench.report import Target, print_report
from bench.rigs.lockstep import lockstep_rig
from bench.study.before import code_before
from bench.study.pairs import Ratio, in_turns, named, ratio, sides
from daemon.config.schema import Configuration, Sinusoid, Trajectory
from daemon.modes.table import Event, Mode
from estimator.motor_position import Side
from estimator.settings import Variant

# Amplitude [rad] and frequency [Hz] per joint: incommensurable, so that all poses are met.
MOTION = {
    "LShoulderPitch": (0.35, 0.15),
    "LShoulderYaw": (0.15, 0.23),
    "LElbowRoll": (0.5, 0.19),
    "LElbowYaw": (0.3, 0.29),
    "LWristRoll": (0.6, 0.13),
    "LWristYaw": (0.2, 0.31),
    "LWristPitch": (0.4, 0.37),
}
BESIDE = (
    Variant(kind="classical", friction=False, rotor_inertia=False, label="classical"),
    Variant(kind="classical", friction=True, rotor_inertia=False, label="classical+friction"),
    Variant(kind="classical", friction=True, rotor_inertia=True, label="classical+friction+rotor"),
    Variant(kind="backlash", rotor_inertia=False, label="backlash-rotor"),
    Variant(kind="two_mass", label="two_mass"),
)


def moving(motor_position: str, motion: Mapping[str, tuple[float, float]] = MOTION) -> Any:
    """A change of the configuration: all joints move, all residuals run. motion: amplitude [rad]
    and frequency [Hz] per joint."""

    def change(c: Configuration) -> Configuration:
        waves = {n: Sinusoid(amplitude=a, frequency_Hz=f) for n, (a, f) in motion.items()}
        return msgspec.structs.replace(
            c,
            trajectory=Trajectory(sinusoids=waves, ramp_s=2.0),
            estimator=msgspec.structs.replace(
                c.estimator, beside=BESIDE, motor_position=motor_position
            ),
        )

    return change


def contact_free(seconds: float, seed: int, friction: str, motor_position: str) -> dict[str, Any]:
    """Results of one run: largest |r| per joint and false contacts, by residual; the 99th
    percentile of the error of phi [mrad], the share of samples that are in the gap, and that of
    samples judged to be."""
    with lockstep_rig(
        configure=moving(motor_position),
        simulate=lambda s: msgspec.structs.replace(s, seed=seed, friction=friction),
    ) as rig:
        rig.enable()
        rig.run(1.0)
        rig.request(Event.START)
        names = ["backlash", *(variant.name for variant in BESIDE)]
        largest = {name: np.zeros(len(MOTION)) for name in names}
        alarms = dict.fromkeys(names, 0)
        above = {name: np.zeros(len(MOTION), dtype=bool) for name in names}
        plant = rig.arm.plant
        phi_before, free_before = plant.phi.copy(), plant.in_gap
        phi_errors: list[Vector] = []
        in_gap, said_gap = np.zeros((2, len(MOTION)))

        def each() -> None:
            nonlocal phi_before, free_before
            estimate = rig.estimate
            # An estimate belongs to the middle between two samples, and so does this truth.
            phi, free = plant.phi.copy(), plant.in_gap
            phi_errors.append(np.abs(estimate.phi - 0.5 * (phi + phi_before)))
            np.add(in_gap, free & free_before, out=in_gap)
            np.add(said_gap, estimate.side == Side.GAP, out=said_gap)
            phi_before, free_before = phi, free
            for name, r in {"backlash": estimate.residual, **estimate.beside}.items():
                size = np.abs(r)
                np.maximum(largest[name], size, out=largest[name])
                now = size > estimate.threshold
                alarms[name] += int(np.count_nonzero(now & ~above[name]))
                above[name] = now

        rig.run(seconds, each)
        assert rig.mode is Mode.TRACKING, rig.tick.controller.machine.cause
    return {
        "friction": friction,
        "motor_position": motor_position,
        "seconds": seconds,
        "largest_nm": {name: rounded(r) for name, r in largest.items()},
        "alarms": alarms,
        "phi_error_p99_mrad": rounded(1000 * np.percentile(phi_errors, 99, axis=0)),
        "in_gap_percent": rounded(100 * in_gap / len(phi_errors)),
        "said_gap_percent": rounded(100 * said_gap / len(phi_errors)),
    }


def lockstep_speed(seconds: float, seed: int, before: Path | None) -> tuple[float, Ratio | None]:
    """Simulated seconds per second of CPU time, bus, daemon and plant as configured, and the ratio
    of this speed to that of before; medians over stretches of one second in turns, since others use
    the machine too."""
    with sides("lockstep", before, lambda _: {"seed": seed}) as found:
        rounds = max(round(seconds), 1)
        took, then = in_turns(found, rounds, lambda w: float(w.ask(seconds=1.0)["cpu_s"]))
    faster = ratio(list(zip(then, took, strict=True))) if then else None
    return 1.0 / float(np.median(took)), faster


def rounded(values: Vector) -> list[float]:
    """Three decimals are enough to read."""
    return [round(float(value), 3) for value in values]


@click.command(help=help_of(__doc__))
@click.option("--seconds", type=click.FloatRange(1.0, 36000.0), default=120.0, show_default=True)
@SEED
@click.option("--json", "as_json", is_flag=True)
def main(seconds: float, seed: int, as_json: bool) -> None:
    runs = []
    for friction in ("smooth", "dahl"):
        for motor_position in ("measured", "integrated"):
            run = contact_free(seconds, seed, friction, motor_position)
            runs.append(run)
            if as_json:
                continue
            click.echo(
                f"\n{seconds:g} s, {friction} friction, theta {motor_position}, seed {seed}: "
                "largest |r| per joint [Nm], alarms"
            )
            for name, largest in run["largest_nm"].items():
                row = " ".join(f"{x:6.3f}" for x in largest)
                click.echo(f"  {name:26} {row}   {run['alarms'][name]:5}")
            for name in ("phi_error_p99_mrad", "in_gap_percent", "said_gap_percent"):
                click.echo(f"  {name:26} " + " ".join(f"{x:6.2f}" for x in run[name]))
    targets = [
        Target(
            f"false contacts, backlash, {run['friction']}, theta {run['motor_position']}",
            run["alarms"]["backlash"],
            0,
            "",
            "lower",
        )
        for run in runs
    ]
    with code_before() as before:
        speed, faster = lockstep_speed(min(seconds, 20.0), seed, before)
    targets.append(Target("lockstep speed, by CPU time", speed, 15, "x real time", "higher"))
    if faster is not None:
        targets.append(Target("lockstep speed over before's", faster.median, 3, "x", "higher"))
    if not as_json:
        click.echo(f"\n{named(before)}; lockstep {speed:.1f} times real time, {faster or 'alone'}")
    data = {"runs": runs, "before": named(before), "faster": faster and faster.data()}
    print_report("contact_free", seed, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
