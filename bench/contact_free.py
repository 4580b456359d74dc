"""Contact-free motion of all joints in lockstep: what each residual raises by itself.

    python -m bench.contact_free [--seconds S] [--seed N] [--json]

The plant differs from the model by the default mismatch of `simulation.yaml`; thresholds are the
paper's, raised near rest. Every variant of the residual runs on the same samples.
"""

import time
from typing import Any

import click
import msgspec
import numpy as np

from bench.figures import Target, print_report
from bench.lockstep import lockstep_rig
from daemon.config.schema import Configuration, Sinusoid, Trajectory
from daemon.modes import Event, Mode
from estimator.residual import Variant

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


def moving(motor_position: str) -> Any:
    """A change of the configuration: all joints move, all residuals run."""

    def change(c: Configuration) -> Configuration:
        waves = {n: Sinusoid(amplitude=a, frequency_Hz=f) for n, (a, f) in MOTION.items()}
        return msgspec.structs.replace(
            c,
            trajectory=Trajectory(sinusoids=waves, ramp_s=2.0),
            estimator=msgspec.structs.replace(
                c.estimator, beside=BESIDE, motor_position=motor_position
            ),
        )

    return change


def contact_free(seconds: float, seed: int, friction: str, motor_position: str) -> dict[str, Any]:
    """One run: largest |r| per joint and false contacts, by residual; and how fast it went."""
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

        def each() -> None:
            estimate = rig.cycle.estimate
            assert estimate is not None
            for name, r in {"backlash": estimate.residual, **estimate.beside}.items():
                size = np.abs(r)
                np.maximum(largest[name], size, out=largest[name])
                now = size > estimate.threshold
                alarms[name] += int(np.count_nonzero(now & ~above[name]))
                above[name] = now

        begun = time.perf_counter()
        rig.run(seconds, each)
        took = time.perf_counter() - begun
        assert rig.mode is Mode.TRACKING, rig.cycle.controller.machine.cause
    return {
        "friction": friction,
        "motor_position": motor_position,
        "seconds": seconds,
        "largest_nm": {name: [round(float(x), 3) for x in r] for name, r in largest.items()},
        "alarms": alarms,
        "times_real_time": round(seconds / took, 2),
    }


@click.command(help=__doc__)
@click.option("--seconds", default=120.0, show_default=True)
@click.option("--seed", default=1, show_default=True)
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
                f"\n{seconds:g} s, {friction} friction, theta {motor_position}, seed {seed}, "
                f"{run['times_real_time']}x real time: largest |r| per joint [Nm], alarms"
            )
            for name, largest in run["largest_nm"].items():
                row = " ".join(f"{x:6.3f}" for x in largest)
                click.echo(f"  {name:26} {row}   {run['alarms'][name]:5}")
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
    targets.append(
        Target("lockstep speed", min(r["times_real_time"] for r in runs), 5, "x", "higher")
    )
    print_report("contact_free", seed, targets, {"runs": runs}, as_json=as_json)


if __name__ == "__main__":
    main()
