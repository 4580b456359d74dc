"""Steps of external torque on each joint alone, in motion and at rest, in lockstep: the
share that is detected, and the delay after the onset in the plant.

    python -m bench.steps [--seed N] [--friction smooth|dahl] [--json]

In motion: twice the threshold. At rest: the larger of twice the threshold and the threshold plus
half the static friction, above which stiction cannot hide it. A step towards the side of the gap on
which the link leans already needs no travel; the other way it may first have to cross.
"""

from typing import Any

import click
import msgspec
import numpy as np

from bench.contact_free import moving
from bench.options import SEED, help_of
from bench.report import Target, print_report
from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.modes.table import Event

PATIENCE_S = 0.5
REST_S = 2.0  # between two steps
TRIALS_IN_MOTION = 6


def delay_of(rig: Rig, joint: int, torque: float) -> tuple[float | None, bool]:
    """Put `torque` [Nm] on one joint until the contact is detected; (delay [s] or None, the gap was
    crossed)."""
    plant, period = rig.arm.plant, rig.robot.configuration.period_s
    begun = rig.arm.now
    side = np.sign(plant.phi[joint])
    rig.arm.external_torque[joint] = torque
    detected_s: float | None = None
    crossed = False
    for _ in range(round(PATIENCE_S / period)):
        rig.step()
        crossed |= bool(np.sign(plant.phi[joint]) != side)
        estimate = rig.estimate
        if estimate.thresholded[joint] * torque > 0.0:
            detected_s = rig.arm.now - begun
            break
    rig.arm.external_torque[joint] = 0.0
    rig.run(REST_S)
    return detected_s, crossed and plant.parameters.half_gap[joint] > 0.0


def steps(seed: int, friction: str, *, in_motion: bool) -> list[dict[str, Any]]:
    """Every joint, both signs; in motion at several moments."""
    rows = []
    with lockstep_rig(
        configure=moving("measured"),
        simulate=lambda s: msgspec.structs.replace(s, seed=seed, friction=friction),
    ) as rig:
        rig.enable()
        rig.run(1.0)
        if in_motion:
            rig.request(Event.START)
            rig.run(5.0)
        for i, joint in enumerate(rig.robot.configuration.joints):
            contact = joint.thresholds.contact
            stuck = joint.friction.motor_coulomb + joint.friction.link_coulomb
            size = 2 * contact if in_motion else max(2 * contact, contact + 0.5 * stuck)
            direct: list[float] = []
            after_gap: list[float] = []
            missed = 0
            for trial in range(TRIALS_IN_MOTION if in_motion else 2):
                delay, crossed = delay_of(rig, i, size if trial % 2 == 0 else -size)
                if delay is None:
                    missed += 1
                else:
                    (after_gap if crossed else direct).append(round(1000 * delay, 1))
            rows.append(
                {
                    "joint": joint.name,
                    "torque_nm": round(size, 3),
                    "missed": missed,
                    "delays_ms": direct,
                    "delays_with_gap_travel_ms": after_gap,
                }
            )
        gain = rig.robot.configuration.estimator.gain
    return [{**row, "filter_ms": round(1000 * np.log(2) / gain, 1)} for row in rows]


@click.command(help=help_of(__doc__))
@SEED
@click.option("--friction", type=click.Choice(["smooth", "dahl"]), default="smooth")
@click.option("--json", "as_json", is_flag=True)
def main(seed: int, friction: str, as_json: bool) -> None:
    data: dict[str, Any] = {"friction": friction}
    targets = []
    for name, in_motion in (("in motion", True), ("at rest", False)):
        rows = data[name] = steps(seed, friction, in_motion=in_motion)
        missed = sum(row["missed"] for row in rows)
        targets.append(Target(f"steps {name} that were not felt", missed, 0, "", "lower"))
        if as_json:
            continue
        click.echo(f"\n{name}, {friction} friction, seed {seed}; delay from onset [ms]")
        for row in rows:
            click.echo(
                f"  {row['joint']:16} {row['torque_nm']:5.2f} Nm  missed {row['missed']}  "
                f"direct {row['delays_ms']}  through the gap {row['delays_with_gap_travel_ms']}"
            )
    print_report("steps", seed, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
