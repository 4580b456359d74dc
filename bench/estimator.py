"""CPU time of one estimator step, against the bare pinocchio calls that it cannot avoid.

    python -m bench.estimator [--repetitions N] [--json]

Mass matrix, Coriolis matrix and gravity by pinocchio, called from Python, are the least that a
residual costs. Both sides work on the same poses, in turns of a few steps, in one run, for one
joint, for Romeo's arm, and for two such arms on one torso. The estimator is that of the arm's
configuration. Also counted: the memory blocks that are left over after many steps.
"""

import gc
import statistics
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Final

import click
import numpy as np
import pinocchio as pin

from bench.options import command
from bench.report import Target, print_report
from bench.rigs.lockstep import ROMEO, SINGLE_JOINT
from common.arrays import Matrix
from daemon.assembly import build_estimator, build_transmission
from daemon.config.load import Robot, load_robot
from estimator.estimator import Estimator
from estimator.model import Model
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission

TURN: Final = 20  # steps between two looks at the clock
TICKS: Final = 200  # of the motion that is gone through again and again
LATE: Final = 20_000  # steps after which nothing more may have been kept


@dataclass(frozen=True, slots=True)
class Subject:
    """An arm: its estimator, and the same model for pinocchio alone."""

    name: str
    estimator: Estimator
    model: pin.Model


def subjects() -> list[Subject]:
    """Arms of 1, 7 and 14 joints."""
    single, romeo = load_robot(SINGLE_JOINT), load_robot(ROMEO)
    return [
        Subject("1 joint", build_estimator(single.configuration, single.model), _bare(single.urdf)),
        Subject("7 joints", build_estimator(romeo.configuration, romeo.model), _bare(romeo.urdf)),
        _pair(romeo),
    ]


def _bare(urdf: str) -> pin.Model:
    return pin.buildModelFromXML(urdf)


def _pair(robot: Robot) -> Subject:
    """Two of these arms as one: everything twice but the period."""
    c, urdf = robot.configuration, two_arms(robot.urdf)
    one = build_transmission(c)
    twice = {
        field.name: np.tile(getattr(one, field.name), 2)
        for field in fields(Transmission)
        if field.name not in ("joints", "sign_width")
    }
    joints = tuple(f"{arm}_{name}" for arm in ARMS for name in c.joint_names)
    transmission = Transmission(joints=joints, sign_width=one.sign_width, **twice)
    thresholds = Thresholds(
        contact=np.array([joint.thresholds.contact for joint in c.joints] * 2),
        collision=np.array([joint.thresholds.collision for joint in c.joints] * 2),
    )
    model = Model(urdf, joints)
    estimator = Estimator(model, transmission, c.estimator, thresholds, c.period_s)
    return Subject(f"{len(joints)} joints", estimator, _bare(urdf))


ARMS: Final = ("a", "b")


def two_arms(urdf: str) -> str:
    """The same chain twice on one torso, its names behind `a_` and `b_`."""
    both = ET.Element("robot", name="two_arms")
    ET.SubElement(both, "link", name="torso")
    for arm in ARMS:
        one = ET.fromstring(urdf)
        links = {link.get("name") for link in one.findall("link")}
        links -= {child.get("link") for child in one.findall("joint/child")}
        for element in one.iter():
            for key in ("name", "link"):
                if element is not one and element.get(key) is not None:
                    element.set(key, f"{arm}_{element.get(key)}")
        both.extend(one)
        for root in links:
            joint = ET.SubElement(both, "joint", name=f"{arm}_on_torso", type="fixed")
            ET.SubElement(joint, "parent", link="torso")
            ET.SubElement(joint, "child", link=f"{arm}_{root}")
    return ET.tostring(both, encoding="unicode")


def motion(n: int, period_s: float) -> tuple[Matrix, Matrix, Matrix]:
    """Link positions, velocities and currents, each (TICKS, n), of sinusoids that close."""
    t = np.arange(TICKS)[:, np.newaxis] * period_s
    omega = 2.0 * np.pi / (TICKS * period_s) * np.arange(1, n + 1).clip(max=3)
    phase = omega * t + np.linspace(0.0, 3.0, n)
    return 0.3 * np.sin(phase), 0.3 * omega * np.cos(phase), 0.1 * np.sin(2 * phase)


def _turns(subject: Subject) -> tuple[Callable[[], None], Callable[[], None]]:
    """One turn of our steps, and one of the bare calls on the same poses."""
    estimator, model, data = subject.estimator, subject.model, subject.model.createData()
    q, q_dot, current = motion(model.nv, estimator.period_s)
    ours = bare = 0

    def step() -> None:
        nonlocal ours
        for k in range(ours, ours + TURN):
            i = k % TICKS
            estimator.step(current[i], q[i], q_dot[i], q[i])
        ours += TURN

    def call() -> None:
        nonlocal bare
        for k in range(bare, bare + TURN):
            i = k % TICKS
            pin.crba(model, data, q[i])
            pin.computeCoriolisMatrix(model, data, q[i], q_dot[i])
            pin.computeGeneralizedGravity(model, data, q[i])
        bare += TURN

    return step, call


def measure(subject: Subject, repetitions: int) -> dict[str, Any]:
    """Medians over `repetitions` turns of either side [us per step], and of their ratios."""
    step, call = _turns(subject)
    for warm_up in (step, call) * 5:
        warm_up()
    gc.collect()
    gc.disable()
    try:
        took = [(_time(step), _time(call)) for _ in range(repetitions)]
    finally:
        gc.enable()
    ours, bare = zip(*took, strict=True)
    return {
        "arm": subject.name,
        "step_us": round(1e6 * statistics.median(ours) / TURN, 1),
        "pinocchio_us": round(1e6 * statistics.median(bare) / TURN, 1),
        "ratio": round(statistics.median(a / b for a, b in took), 2),
        "kept_blocks": kept(step),
    }


def _time(work: Callable[[], None]) -> float:
    begun = time.thread_time()  # others use this machine too
    work()
    return time.thread_time() - begun


def kept(step: Callable[[], None]) -> int:
    """Blocks of Python memory that LATE steps leave behind."""
    step()
    gc.collect()
    before = sys.getallocatedblocks()
    for _ in range(LATE // TURN):
        step()
    gc.collect()
    return sys.getallocatedblocks() - before


@command(__doc__)
@click.option("--repetitions", type=click.IntRange(min=1), default=200, help="Turns of 20 steps.")
def main(repetitions: int, as_json: bool) -> None:
    rows = [measure(subject, repetitions) for subject in subjects()]
    targets = [
        Target(f"step over bare pinocchio calls, {row['arm']}", row["ratio"], 4, "x")
        for row in rows
        if row["arm"] != "1 joint"
    ]
    most = max(row["kept_blocks"] for row in rows)
    targets.append(Target(f"memory blocks kept after {LATE} steps", most, 20))
    print_report("estimator", 0, targets, {"arms": rows}, as_json=as_json)


if __name__ == "__main__":
    main()
