"""Runs of `bench.wrench`: one arm on which hands press, and the estimates in every tick."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Literal

import numpy as np
import yaml
from msgspec.structs import replace

from bench.rigs.arm_without_bus import Motion, Scenario, record, recordings
from bench.rigs.generated_arms import generate, in_yaml
from bench.rigs.lockstep import BEAM, OPENARM, ROMEO
from bench.study import courses, population, world
from bench.study.estimates import rows_of
from bench.study.hands import PRESSES_S, Hands, Press, drawn
from bench.study.world import Law
from bench.study.wrench_bound import posteriors
from common.arrays import Vector
from daemon.assembly import build_estimator
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from estimator.estimate import EstimateRows
from estimator.estimator import Estimator
from estimator.wrench import COVARIANCE, MISFIT, SEEN_MOST_N, SEEN_N, SEEN_SHARE, STRENGTH
from programs.recordings.touch_point import TouchFinder

Kind = Literal["motion", "slow", "rest", "stretched", "free"]
FIRST_S: Final = 0.1  # of a press, in which the residual still rises
EVERY: Final = 4  # ticks
AFTER_S: Final = 0.6  # after a press, until it is over
SLOW: Final = 0.15
ROTOR_KG_M2_PER_NM: Final = 0.004  # of Romeo's drives, over their strongest torque
UPPER: Final = np.triu_indices(3)


@dataclass(frozen=True, slots=True)
class Job:
    """One arm in one kind of motion: romeo, openarm, beam, or the seed of a generated one."""

    arm: str
    kind: Kind
    law: Law
    seed: int
    worked_s: float = 600.0
    seconds: float = 60.0


def robot_of(arm: str, folder: Path) -> Robot:
    """Arm with Romeo's drives, which the rig can simulate."""
    if arm == "romeo":
        return load_robot(ROMEO)
    source = {"openarm": OPENARM, "beam": BEAM}.get(arm)
    source = source or generate(int(arm)).write(folder / "source")
    c, of_romeo = (yaml.safe_load((f / "config.yaml").read_text()) for f in (source, ROMEO))
    for name in ("drives", "bus", "estimator"):
        c[name] = of_romeo[name]
    for node, joint in enumerate(c["joints"], start=1):
        wiring = joint["wiring"]
        most = wiring["max_current_A"]
        if arm == "beam":  # so stiff a velocity loop is unstable with such light rotors
            strongest = most * joint["torque_constant"]
            joint["rotor_inertia"] = round(ROTOR_KG_M2_PER_NM * strongest, 5)
        joint["wiring"] = {
            "node": node, "profile": next(iter(c["drives"])), "gear": wiring["gear"],
            "rated_current_A": round(0.5 * most + 0.01, 3), "max_current_A": most,
        }  # fmt: skip
    target = folder / "arm"
    target.mkdir()
    (target / "config.yaml").write_text(in_yaml(c))
    (target / c["urdf"]).write_text((source / c["urdf"]).read_text())
    (target / "drive.eds").write_text((ROMEO / "drive.eds").read_text())
    return load_robot(target)


def run(job: Job) -> dict[str, Any]:
    """Arrays of one run, a row for each tick that counts; see `said`."""
    with TemporaryDirectory() as folder:
        robot = robot_of(job.arm, Path(folder))
        c = robot.configuration
        estimator = build_estimator(
            replace(c, estimator=replace(c.estimator, beside=())), robot.model
        )
        subject = world.subject(robot, job.law, job.seed)
        course, _ = courses.day(c, job.seed, job.worked_s)
        work = Scenario(seconds=job.worked_s, motion=course, begin_s=-job.worked_s)
        for before in recordings(subject, work):
            rows_of(estimator, before.samples)
        estimator.restart()
        path, onsets = motion(job, c)
        ticks = np.rint(np.array(onsets) / c.period_s).astype(int)
        poses = path.course(round(job.seconds / c.period_s), c.period_s).q[ticks]
        strength = np.array([j.torque_constant * j.wiring.max_current_A for j in c.joints])
        presses = drawn(Hands(robot.model, robot.urdf), onsets, poses, strength, job.seed)
        hands = Hands(robot.model, robot.urdf, presses)
        recording = record(subject, Scenario(seconds=job.seconds, motion=path, act=hands))
        rows = rows_of(estimator, recording.samples)
    contact = np.array([joint.thresholds.contact for joint in c.joints])
    finder = TouchFinder(robot.urdf, robot.model.names, contact)
    return said(job, hands, rows, recording.time_s, estimator, finder, contact)


def motion(job: Job, c: Configuration) -> tuple[Motion, list[float]]:
    """Path of a run, and the times of its presses [s]; none for a free run."""
    if job.kind in ("rest", "stretched"):
        path = population.motion(c, job.seed, go_s=population.GO_S, rest_s=population.REST_S)
        onsets = population.onsets_at_rest(job.seconds, job.seed)
    else:
        path = population.motion(c, job.seed, held=0.0)
        onsets = population.onsets_in_motion(job.seconds, job.seed) if job.kind != "free" else []
    if job.kind == "slow":
        path = dataclasses.replace(path, omega=SLOW * path.omega)
    if job.kind == "stretched":  # links in a line, as far as the limits permit
        room = courses.Room.of(c)
        home, way = np.clip(0.0, room.lower, room.upper), np.minimum(path.amplitude, 0.02)
        path = dataclasses.replace(path, home=home, amplitude=way)
    return path, [round(0.001 * ms, 2) for ms in onsets]


def said(
    job: Job, hands: Hands, rows: EstimateRows, t: Vector, estimator: Estimator,
    finder: TouchFinder, contact: Vector,
) -> dict[str, Any]:  # fmt: skip
    """Results: for every press the named links, tick by tick, and the point of contact; for presses
    at the tool the force and its bounds; between presses whether a force was shown."""
    free = t > FIRST_S + 1.0
    forces: list[dict[str, Any]] = []
    links: list[dict[str, Any]] = []
    bounds = iter(posteriors(hands, rows, t, contact) if hands.presses else ())
    for press in hands.presses:
        end = press.onset_s + PRESSES_S
        free &= (t <= press.onset_s) | (t > end + AFTER_S)
        during = np.flatnonzero((t > press.onset_s) & (t <= end))
        last = press.touches[-1]
        if press.place != "two":
            links.append(
                {"row": last.row, "named": rows.touched_link[during], "n": len(contact),
                 "tool": press.place != "link", "size": float(np.linalg.norm(last.force)),
                 "kind": job.kind, "touches": _touches(hands, press, rows, t, finder),
                 "bound": next(bounds)}
            )  # fmt: skip
        for k in during[t[during] > press.onset_s + FIRST_S][::EVERY].tolist():
            forces.append(_force(hands, press, rows, k, estimator, contact))
            forces[-1]["after_s"] = float(t[k] - press.onset_s)
    acts = rows.wrench[:, STRENGTH] > 1.0
    begins = acts[1:] & ~acts[:-1] & free[1:] & free[:-1]
    return {
        "job": job,
        "forces": forces,
        "links": links,
        "free_s": float(np.count_nonzero(free) * estimator.period_s),
        "false": int(np.count_nonzero(begins)),
    }


def _touches(
    hands: Hands, press: Press, rows: EstimateRows, t: Vector, finder: TouchFinder
) -> list[dict[str, Any]]:
    """Touched link and point reported in the ticks of a press that name any."""
    touch, names, said = press.touches[-1], hands.model.names, []
    for k in np.flatnonzero((t > press.onset_s - FIRST_S) & (t <= press.onset_s + PRESSES_S)):
        q, r, level = rows.q[k], rows.residual[k], rows.threshold[k]
        found = finder.take(q, r, level, rows.level_share[k], t[k] - t[k - 1])
        if found is None or t[k] <= press.onset_s:
            continue
        rotation, origin = finder.frames[found.link]
        away = rotation @ found.point + origin - hands.place(q, touch.row, touch.point)
        rows_of_links = [names.index(joint) - touch.row for joint in found.joints]
        said.append(
            {"after_s": float(t[k] - press.onset_s), "decided": found.decided,
             "first": rows_of_links[0], "least": min(rows_of_links), "placed": found.placed,
             "error": float(np.linalg.norm(away)), "doubt": found.doubt_m}
        )  # fmt: skip
    return said


def _force(
    hands: Hands, press: Press, rows: EstimateRows, k: int, estimator: Estimator, contact: Vector
) -> dict[str, Any]:
    """Force reported in tick k, and the true one, along the axes of the tool."""
    model, q, row = estimator.model, rows.q[k], rows.wrench[k]
    place, last = model.place(estimator.settings.force_at), model.hand_joint
    axes = hands.turned(q, last) @ place.axes
    J = axes.T @ hands.jacobian(q, last, place.point)
    covariance = np.zeros((3, 3))
    covariance[UPPER] = row[COVARIANCE : COVARIANCE + 6]
    covariance = covariance + np.triu(covariance, 1).T
    most = max(SEEN_N, min(SEEN_SHARE * float(np.linalg.norm(row[:3])), SEEN_MOST_N))
    variances, ways = np.linalg.eigh(covariance)
    truth = axes.T @ press.touches[0].force
    error = ways.T @ (row[:3] - truth)
    sigma, seen = np.sqrt(variances), np.sqrt(variances) <= most
    # Directions, and the effect of 60 N along each, in contact levels.
    levers, _, _ = np.linalg.svd(J / contact)
    shows = 60.0 * np.abs(levers.T @ (J / contact)).max(axis=1)
    spread = np.sqrt(np.einsum("ik,ij,jk->k", levers, covariance, levers))
    naive = np.linalg.pinv(J.T) @ rows.residual[k]
    return {
        "place": press.place, "acts": bool(row[STRENGTH] > 1.0), "misfit": float(row[MISFIT]),
        "size": float(np.linalg.norm(truth)), "speed": float(np.abs(rows.q_dot[k]).max()),
        "error": error, "sigma": sigma, "seen": seen, "shows": shows, "called": spread <= most,
        "naive": float(np.linalg.norm(naive - truth)), "force": row[:3], "truth": truth,
        "reach": float(np.linalg.cond(J)), "strength": float(row[STRENGTH]),
    }  # fmt: skip
