"""Our residual beside its rivals, recurrent networks among them, before and after the arm changes.

    python -m bench.rivals [--arms N] [--seed N] [--jobs N] [--quick] [--json]

Arms of `bench.detection`, a law of friction each in turns. Each moves freely for ten minutes, in
two thirds of each joint's range: the networks train on them, the product learns meanwhile. Five
more minutes without contact give every residual its levels by one rule: per joint, MARGIN times the
largest that it was. The product comes twice, by that rule and `as shipped`, by its level in force.
Then, with the same motion and the same hands for all, five minutes without contact and three with
hands (half-second steps of torque on single joints, from a tenth to eight configured levels):

    as trained          other motion of the same kinds, in the same range
    payload             the same with MASS in the hand, which nothing announces
    payload, announced  the same with the models informed; `gru` has none
    cold gear           as trained, with COLD times the friction
    new path            in the whole range of each joint

A hand is felt if the residual of its joint goes beyond the level in its direction while it pushes,
and was not before. "Missed" and delays are of hands of USUAL configured levels and more; from
"smallest" on, in these levels, nine of ten are felt. The networks: pip install '.[rivals]'.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import click
import msgspec
import numpy as np

from bench.options import FIRST_SEED, JOBS, command
from bench.report import Target, plain, print_report
from bench.rigs.arm_without_bus import Carried, Recording, Scenario, record
from bench.rigs.lockstep import ROMEO
from bench.study import courses, population, world
from bench.study.estimates import build, estimates
from bench.study.monte_carlo import spread
from bench.study.population import STEP_MS, Step
from bench.study.rivals import KALMAN, KALMAN_BELIEF, Recipe, Recurrent, seen_by_network, torch
from bench.study.scores import count_alarms, filtered, percentile
from common.arrays import Matrix
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from estimator.alarms import per_hour
from estimator.model import Model
from estimator.payload import Payload

MARGIN, USUAL = 1.25, 2.0
MASS, COLD = 0.3, 1.5  # [kg]; friction over its own
RANGE: Final = 2.0 / 3.0  # of each joint, in which the networks train
PART_S: Final = 6.0  # of one kind of motion, so that ten minutes hold many poses
TIMES_S: Final = (600.0, 900.0, 300.0, 180.0)
"""of training, all before the change, then without contact, with hands"""
TASTE_S: Final = (60.0, 80.0, 20.0, 20.0)  # the same of --quick
SETTLED_S: Final = 3.0  # from switching on, before which nothing counts
CHANGES: Final = ("as trained", "payload", "payload, announced", "cold gear", "new path")
GRU, HYBRID, OURS, SHIPPED = "gru", "gru+momentum", "backlash", "as shipped"
RIVALS: Final = ("classical", "two_mass", KALMAN, GRU, HYBRID, OURS)


@dataclass(frozen=True, slots=True)
class Cell:
    """Answers of one residual to one change of one arm."""

    seconds: float  # without contact
    alarms: int
    above_s: float  # meanwhile, beyond the level of any joint
    hands: list[tuple[float, float]]  # size in configured levels, delay [s], inf: not felt


def figures(cells: Sequence[Cell]) -> dict[str, Any]:
    """Figures of several arms; delays of hands that were felt [ms]."""
    hands, seconds = [hand for cell in cells for hand in cell.hands], sum(c.seconds for c in cells)
    strong = [delay for size, delay in hands if size >= USUAL * (1.0 - 1e-9)]
    felt = [1000.0 * delay for delay in strong if delay < math.inf]
    return {
        "false_per_hour": per_hour(sum(c.alarms for c in cells), seconds),
        "above_percent": 100.0 * sum(c.above_s for c in cells) / seconds,
        "missed_percent": 100.0 * (1.0 - len(felt) / len(strong)) if strong else math.nan,
        "smallest": smallest(hands),
        "delay_ms": [percentile(felt, 50), percentile(felt, 95)],
        "hands": [len(strong), len(hands)],
    }


def smallest(hands: Sequence[tuple[float, float]]) -> float:
    """Smallest size from which on nine of ten hands are felt; inf where those of none are."""
    best, felt = math.inf, 0
    for count, (size, delay) in enumerate(sorted(hands, reverse=True), 1):
        felt += delay < math.inf
        best = size if 10 * felt >= 9 * count else best
    return best


def delay_s(seen: Recording, r: Matrix, level: Matrix, step: Step) -> float:
    """Delay [s] after which a hand is felt; inf: not while it pushed, or beyond already."""
    first, i = step.onset_ms // seen.per_tick, step.joint
    ticks = slice(first - 1, first + STEP_MS // seen.per_tick)
    beyond = np.sign(step.torque) * r[ticks, i] > level[ticks, i]
    if beyond[0] or not beyond.any():
        return math.inf
    return 1e-3 * (seen.per_tick * (first + int(np.argmax(beyond))) - step.onset_ms)


def within(c: Configuration, share: float) -> Configuration:
    """The arm as if each joint ended after so much of its range."""
    new, joints = msgspec.structs.replace, []
    for one in c.joints:
        upper = one.limits.lower + share * (one.limits.upper - one.limits.lower)
        joints.append(new(one, limits=new(one.limits, upper=upper)))
    return new(c, joints=joints)


class Rivals:
    """All residuals of one arm, trained on so many ticks, with levels of those after them."""

    def __init__(self, robot: Robot, before: Recording, ticks: int, seed: int, r: Recipe) -> None:
        self._c, self._networks = robot.configuration, dict[str, Recurrent]()
        self._estimator = build(robot, motor_position="measured")
        inputs, every, _ = self._residuals(before)
        for name in (GRU, HYBRID):
            network = Recurrent(inputs[:ticks], every[name][:ticks], seed, r)
            every[name] = every[name] - network.expects(inputs)
            self._networks[name] = network
        self._levels = {n: MARGIN * np.abs(r[ticks:]).max(axis=0) for n, r in every.items()}
        self._memory = self._estimator.memory()

    def _residuals(self, seen: Recording) -> tuple[Matrix, dict[str, Matrix], Matrix]:
        """Inputs of the networks, residuals by name, and the product's threshold in force."""
        found, c = estimates(self._estimator, seen), self._c
        torque = np.array([joint.torque_constant for joint in c.joints]) * seen.samples[:, 0]
        without_model = filtered(-torque, c.estimator.gain, c.period_s)
        every = found.residuals | {GRU: without_model, HYBRID: found.residuals[KALMAN_BELIEF]}
        inputs = seen_by_network(seen.samples, c.period_s)
        for name, network in self._networks.items():
            every[name] = every[name] - network.expects(inputs)
        return inputs, {name: every[name] for name in RIVALS}, found.threshold

    def judged(
        self, seen: Recording, steps: list[Step], free_s: float, payload: Payload | None
    ) -> Iterator[tuple[str, Cell]]:
        """Each residual with its answers; the product goes on from before the change."""
        self._estimator.restore(self._memory)
        self._estimator.restart()
        self._estimator.carry(payload)
        _, every, in_force = self._residuals(seen)
        period_s, contact = self._c.period_s, [one.thresholds.contact for one in self._c.joints]
        free = slice(round(SETTLED_S / period_s), round(free_s / period_s))
        for name, r in (every | {SHIPPED: every[OURS]}).items():
            level = in_force if name == SHIPPED else np.broadcast_to(self._levels[name], r.shape)
            above_s = period_s * int((np.abs(r[free]) > level[free]).any(axis=1).sum())
            alarms = int(count_alarms(r[free], level[free]).sum())
            hands = [(abs(s.torque) / contact[s.joint], delay_s(seen, r, level, s)) for s in steps]
            yield name, Cell(free_s - SETTLED_S, alarms, above_s, hands)


def run(job: tuple[int, bool]) -> dict[tuple[str, str], Cell]:
    """Every residual under every change, on the arm of a seed, or quickly."""
    (seed, quick), robot = job, load_robot(ROMEO)
    c, law = robot.configuration, world.LAWS[seed % len(world.LAWS)]
    subject, narrow = world.subject(robot, law, seed), within(c, RANGE)
    recipe = Recipe(hidden=8, epochs=2) if quick else Recipe()
    training_s, before_s, free_s, touched_s = TASTE_S if quick else TIMES_S
    course, _ = courses.day(narrow, seed, before_s, PART_S)
    before = record(subject, Scenario(seconds=before_s, motion=course, begin_s=-before_s))
    rivals = Rivals(robot, before, round(training_s / c.period_s), seed, recipe)
    seconds, onsets = free_s + touched_s, population.onsets_in_motion(touched_s, seed)
    onsets = [round(1000.0 * free_s) + onset for onset in onsets]
    contact = [joint.thresholds.contact for joint in c.joints]
    steps = population.steps(c, seed, onsets, USUAL * np.array(contact))
    place, cells = Model(robot.urdf, c.joint_names).tool_place, dict[tuple[str, str], Cell]()
    for change in CHANGES:
        room, announced = c if change == "new path" else narrow, change == "payload, announced"
        scenario = Scenario(
            seconds=seconds,
            motion=courses.day(room, 5000 + seed, seconds, PART_S)[0],
            pushes=population.pushes(steps, len(c.joints)),
            carried=Carried(MASS, place) if "payload" in change else None,
        )
        seen = record(replace(subject, friction=COLD if change == "cold gear" else 1.0), scenario)
        payload = Payload.of(MASS, place.tolist()) if announced else None
        for name, cell in rivals.judged(seen, steps, free_s, payload):
            if not (name == GRU and announced):
                cells[name, change] = cell
    return cells


@command(__doc__)
@click.option("--arms", type=click.IntRange(min=1), default=3)
@FIRST_SEED
@JOBS
@click.option("--quick", is_flag=True, help="Seconds of everything: a taste, no figures.")
def main(arms: int, seed: int, processes: int, quick: bool, as_json: bool) -> None:
    torch()
    done = list(spread(run, [(seed + arm, quick) for arm in range(arms)], processes, "arms"))
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for name, change in done[0]:
        found.setdefault(name, {})[change] = figures([of_arm[name, change] for of_arm in done])
    if not as_json:
        click.echo(f"{'':32}  false/h  above % missed % smallest delay ms")
        for name, change in done[0]:
            rates, (p50, p95) = found[name][change], found[name][change]["delay_ms"]
            four = "".join(f"{rates[one]:9.3g}" for one in list(rates)[:4])
            click.echo(f"{name:13}{change:19}{four} {p50:4.0f}/{p95:.0f}")
    false = {change: f["false_per_hour"] for change, f in found[SHIPPED].items()}
    targets = [Target(f"false an hour, {SHIPPED}, {one}", rate, 0) for one, rate in false.items()]
    data = {"arms": arms, "quick": quick, "found": found}
    print_report("rivals", seed, targets, plain(data, 2), as_json=as_json)


if __name__ == "__main__":
    main()
