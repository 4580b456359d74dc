"""Led by a hand of 1500 N/m from pose to pose, in lockstep: what torque and what work does that
take, against the same arm with its drives off, weightless, where only friction resists?

    python -m bench.hand [--speed RAD_S] [--gain K_A]... [--mass S] [--seed N] [--json]

The hand holds the last link; to each joint it is a spring of 1500 N/m and a damper of 20 N s/m at
its lever. First it leads each joint alone while the trajectory runs, lets go in full motion, and
waits until the trajectory goes on; then the whole arm through a round of poses, resting at each
before it lets go. The arm with its drives off is led the same ways from the same poses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, cast

import click
import msgspec
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bench.figures import Target, print_report
from bench.lockstep import Rig, lockstep_rig
from daemon.config.schema import Configuration
from daemon.modes import Event, Mode
from simulator.arm import SimulatedArm
from simulator.hand import AnyAct, Guide, Hand, Release

Vector = NDArray[np.float64]

STIFFNESS_N_M, DAMPING_NS_M = 1500.0, 20.0
# A grip holds a joint by more than the lever of one point [m].
SMALLEST_LEVER_M = 0.08
STRONGEST_NM = 25.0
STROKE_RAD = 0.4
# The hand lets go of a single joint in full motion, of the whole arm when it has rested so long.
RESTS_S = 0.5
# A way shorter than this says nothing about forces or trembling [rad].
SHORT_RAD = 0.05
# Offsets from where the arm stands at first; the round ends where it began [rad].
ROUND = (
    (-0.4, 0.2, 0.4, -0.3, 0.4, 0.2, 0.3),
    (-0.7, 0.4, 0.0, 0.2, 0.0, -0.2, 0.0),
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)


@dataclass(frozen=True, slots=True)
class Led:
    """What one joint cost the hand, or one way of the whole arm cost it at that joint."""

    joint: str
    peak_nm: float
    usual_nm: float
    """median over the second half of the way"""
    work_j: float
    moved_rad: float
    tremble: float
    """standard deviation of the link's speed over its mean, in the second half of the way"""
    coast_mrad: float = 0.0
    """how far the motors went on after the hand let go, the furthest joint"""
    drift_mrad: float = 0.0
    """and the links, which also fall through their gaps then"""
    resumed_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Way:
    """From where the hand led which joints where [rad]."""

    start: Vector
    to: Mapping[int, float]


class Meter:
    """A hand, and what it does each millisecond."""

    def __init__(self, hand: Hand, arm: SimulatedArm) -> None:
        self._hand, self._plant = hand, arm.plant
        self._torque: list[Vector] = []
        self._velocity: list[Vector] = []
        hand.begin(arm.now)

    @property
    def began(self) -> bool:
        """As the hand."""
        return self._hand.began

    @property
    def touching(self) -> bool:
        """As the hand."""
        return self._hand.touching

    @property
    def done(self) -> bool:
        """As the hand."""
        return self._hand.done

    def begin(self, _: float) -> None:
        """It did so when it came."""

    def torque(self, q: Vector, q_dot: Vector, out: Vector) -> None:
        """As the hand."""
        self._hand.torque(q, q_dot, out)

    def update(self, t: float, q: Vector, period_s: float = 0.001) -> list[str]:
        """As the hand; and what it does then is written down."""
        words = self._hand.update(t, q, period_s)
        if self._hand.touching:
            torque = np.zeros_like(q)
            self._hand.torque(q, self._plant.q_dot, torque)
            self._torque.append(torque)
            self._velocity.append(self._plant.q_dot.copy())
        return words

    def led(self, names: Sequence[str], joint: int, way_s: float) -> Led:
        """What it came to at one joint, led for way_s [s]."""
        torque = np.array(self._torque)[:, joint]
        velocity = np.array(self._velocity)[:, joint]
        way = slice(round(500 * way_s), round(1000 * way_s))
        speed = float(np.abs(velocity[way]).mean())
        return Led(
            joint=names[joint],
            peak_nm=round(float(np.abs(torque).max()), 3),
            usual_nm=round(float(np.median(np.abs(torque[way]))), 3),
            work_j=round(float(np.sum(torque * velocity)) * 0.001, 4),
            moved_rad=round(float(np.sum(velocity)) * 0.001, 4),
            tremble=round(float(np.std(velocity[way])) / max(speed, 1e-6), 3),
        )


def stiffness(arm: SimulatedArm) -> tuple[Vector, Vector]:
    """Spring [Nm/rad] and damper [Nm s/rad] of the hand at each joint (n,), in the present pose."""
    model = arm.plant.parameters.model
    data = model.createData()
    pin.computeJointJacobians(model, data, arm.plant.q)
    grip = data.oMi[model.nv].act(model.inertias[model.nv].lever)
    lever = np.empty(model.nv)
    for i in range(model.nv):
        lever[i] = np.linalg.norm(np.cross(data.J[3:, i], grip - data.oMi[i + 1].translation))
    square = np.maximum(lever, SMALLEST_LEVER_M) ** 2
    return STIFFNESS_N_M * square, DAMPING_NS_M * square


def takes(
    arm: SimulatedArm, names: Sequence[str], way: Mapping[int, float], speed: float, rests_s: float
) -> float:
    """Let the hand lead joints to positions [rad], rest and let go; how long the way is [s]."""
    k, d = stiffness(arm)
    way_s = max(abs(goal - float(arm.plant.q[i])) for i, goal in way.items()) / speed
    script: list[AnyAct] = [
        Guide(
            at_s=0.0,
            to={names[i]: goal},
            speed=max(abs(goal - float(arm.plant.q[i])) / way_s, 1e-3),
            stiffness=float(k[i]),
            damping=float(d[i]),
            max_torque=STRONGEST_NM,
        )
        for i, goal in way.items()
    ]
    script.append(Release(at_s=way_s + rests_s))
    limit = 0.3 * arm.plant.parameters.lightest_link / arm.settings.step_s
    arm.hand = cast(Hand, Meter(Hand(script, names, limit), arm))
    return way_s


def metered(arm: SimulatedArm) -> Meter:
    """The hand that was put there by `takes`."""
    return cast(Meter, arm.hand)


def stroke(c: Configuration, q: Vector, joint: int) -> float:
    """Where to lead a joint: STROKE_RAD towards the middle of its range [rad]."""
    limits = c.joints[joint].limits
    towards = 1.0 if q[joint] < 0.5 * (limits.lower + limits.upper) else -1.0
    return float(q[joint] + towards * min(STROKE_RAD, 0.4 * (limits.upper - limits.lower)))


def lead(
    rig: Rig, to: Mapping[int, float], speed: float, rests_s: float = 0.0
) -> tuple[Way, list[Led]]:
    """Let the hand lead joints of the armed arm, let go, and wait until its trajectory goes on."""
    arm, names = rig.arm, rig.robot.configuration.joint_names
    start = arm.plant.q.copy()
    way_s = takes(arm, names, to, speed, rests_s)
    while not metered(arm).done:
        rig.tick()
    if not yields(rig):
        raise click.ClickException(f"{rig.mode}: {rig.cycle.controller.machine.cause}")
    released, coast, drift = rig.time_s, 0.0, 0.0
    theta, q = arm.plant.theta.copy(), arm.plant.q.copy()
    while yields(rig):
        rig.tick()
        coast = max(coast, float(np.abs(arm.plant.theta - theta).max()))
        drift = max(drift, float(np.abs(arm.plant.q - q).max()))
    rows = [
        replace(
            metered(arm).led(names, i, way_s),
            coast_mrad=round(1000 * coast, 1),
            drift_mrad=round(1000 * drift, 1),
            resumed_s=round(rig.time_s - released, 3),
        )
        for i in to
    ]
    rig.run(1.0)
    return Way(start, to), rows


def yields(rig: Rig) -> bool:
    """Whether somebody leads the arm, or did a moment ago."""
    return rig.mode is Mode.ADMITTANCE


def lead_limp(rig: Rig, way: Way, speed: float) -> list[Led]:
    """The same way with an arm like that of `rig`, its drives off, that weighs nothing."""
    arm = SimulatedArm(rig.arm.description, rig.arm.settings, lambda _: None)
    arm.plant.parameters.model.gravity.linear[:] = 0.0
    arm.plant.place(way.start)
    names = rig.robot.configuration.joint_names
    way_s = takes(arm, names, way.to, speed, 0.0)
    arm.advance(way_s)
    return [metered(arm).led(names, i, way_s) for i in way.to]


def measure(
    speed: float, gains: Mapping[str, float], mass_s: float | None, seed: int
) -> dict[str, Any]:
    """Everything, in one run."""
    with lockstep_rig(
        configure=lambda c: tuned(c, gains, mass_s),
        simulate=lambda s: msgspec.structs.replace(s, seed=seed),
    ) as rig:
        c = rig.robot.configuration
        rig.enable()
        rig.request(Event.START)
        rig.run(2.0)
        if reasons := rig.cycle.controller.arm("the bench"):
            raise click.ClickException("; ".join(reasons))
        origin = rig.arm.plant.q.copy()
        k, _ = stiffness(rig.arm)
        alone = [lead(rig, {i: stroke(c, rig.arm.plant.q, i)}, speed) for i in range(len(c.joints))]
        whole = [
            lead(rig, dict(enumerate(origin + np.array(pose))), speed, RESTS_S) for pose in ROUND
        ]
        gain = np.array([joint.admittance_gain for joint in c.joints])
        return {
            "speed_rad_s": speed,
            "gain": gain.tolist(),
            "stiffness_nm_rad": np.round(k, 1).tolist(),
            "gain_times_stiffness_1_s": np.round(gain * k, 1).tolist(),
            "alone": [asdict(row) for _, rows in alone for row in rows],
            "alone_off": [asdict(row) for way, _ in alone for row in lead_limp(rig, way, speed)],
            "whole": [[asdict(row) for row in rows] for _, rows in whole],
            "whole_off": [[asdict(row) for row in lead_limp(rig, way, speed)] for way, _ in whole],
        }


def tuned(c: Configuration, gains: Mapping[str, float], mass_s: float | None) -> Configuration:
    """With other gains K_a, or another virtual mass."""
    if strangers := set(gains) - set(c.joint_names):
        raise click.BadParameter(f"{', '.join(strangers)}: none of {', '.join(c.joint_names)}")
    joints = [
        msgspec.structs.replace(j, admittance_gain=gains.get(j.name, j.admittance_gain))
        for j in c.joints
    ]
    admittance = c.admittance
    if mass_s is not None:
        admittance = msgspec.structs.replace(admittance, virtual_mass_s=mass_s)
    return msgspec.structs.replace(c, joints=joints, admittance=admittance)


def print_rows(title: str, rows: Sequence[dict[str, Any]], off: Sequence[dict[str, Any]]) -> None:
    """The arm that yields, beside the arm with its drives off."""
    together = len({(row["coast_mrad"], row["resumed_s"]) for row in rows}) == 1
    click.echo(f"\n{title}" + (f": {after_release(rows[0])}" if together else ""))
    click.echo("                    moved   peak  usual   work | off: peak  usual   work | tremble")
    for row, limp in zip(rows, off, strict=True):
        trembles = f"{row['tremble']:.2f}" if abs(row["moved_rad"]) > SHORT_RAD else "-"
        line = (
            f"  {row['joint']:16} {row['moved_rad']:+6.2f} {row['peak_nm']:6.2f} "
            f"{row['usual_nm']:6.2f} {row['work_j']:6.2f} |    {limp['peak_nm']:6.2f} "
            f"{limp['usual_nm']:6.2f} {limp['work_j']:6.2f} | {trembles:>7}"
        )
        click.echo(line if together else f"{line}   {after_release(row)}")


def after_release(row: dict[str, Any]) -> str:
    """What happened when the hand let go."""
    return (
        f"coasts {row['coast_mrad']:.0f}, links drift {row['drift_mrad']:.0f} mrad, "
        f"goes on after {row['resumed_s']:.2f} s"
    )


def targets_of(data: dict[str, Any]) -> list[Target]:
    """Held against what the prototype of this design showed."""
    alone = data["alone"]
    at_rest = [row["coast_mrad"] for rows in data["whole"] for row in rows]
    resumed = [row["resumed_s"] for row in alone]
    ratios = [
        row["work_j"] / limp["work_j"] for row, limp in zip(alone, data["alone_off"], strict=True)
    ]
    return [
        Target("usual torque, joints alone", max(r["usual_nm"] for r in alone), 4, "Nm", "lower"),
        Target("tremble, joints alone", max(r["tremble"] for r in alone), 0.25, "", "lower"),
        Target("work, of that with drives off, median", float(np.median(ratios)), 5, "x", "lower"),
        Target("coasting, let go at rest", max(at_rest), 23, "mrad", "lower"),
        Target("let go in motion, soonest to go on", min(resumed), 2.0, "s", "higher"),
        Target("let go in motion, latest to go on", max(resumed), 2.1, "s", "lower"),
    ]


def read_gains(pairs: Sequence[str]) -> dict[str, float]:
    """JOINT=K_A, as often as wanted."""
    try:
        return {name: float(value) for name, value in (pair.split("=") for pair in pairs)}
    except ValueError:
        raise click.BadParameter("say JOINT=K_A, like LElbowRoll=0.3") from None


@click.command(help=__doc__)
@click.option("--speed", default=0.25, show_default=True, help="Of the hand [rad/s].")
@click.option("--gain", "gains", multiple=True, metavar="JOINT=K_A", help="Another K_a.")
@click.option("--mass", type=float, help="Another virtual mass, as its time constant [s].")
@click.option("--seed", default=1, show_default=True)
@click.option("--json", "as_json", is_flag=True)
def main(
    speed: float, gains: tuple[str, ...], mass: float | None, seed: int, as_json: bool
) -> None:
    data = measure(speed, read_gains(gains), mass, seed)
    if not as_json:
        click.echo(f"led at {speed:g} rad/s, seed {seed}; torques [Nm], work [J], moved [rad]")
        click.echo(f"K_a k_hand [1/s]: {data['gain_times_stiffness_1_s']}")
        print_rows("each joint alone", data["alone"], data["alone_off"])
        for i, (rows, off) in enumerate(zip(data["whole"], data["whole_off"], strict=True), 1):
            print_rows(f"the whole arm to pose {i}", rows, off)
        click.echo("")
    print_report("hand", seed, targets_of(data), data, as_json=as_json)


if __name__ == "__main__":
    main()
