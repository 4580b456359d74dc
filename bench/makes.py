"""Drives of another make beside CANopen: what the same arm detects, and how far its tool drops.

    python -m bench.makes [--arm FOLDER] [--touches N] [--seed S] [--json]

Both arms run in lockstep, with one trajectory and seed. Steps of twice a joint's level in force
at that moment, in motion, begin anywhere in a tick. Each joint has one, then both daemons begin
anew: they remember what interrupts again and again at one place. A delay is until the arm yields,
one that is missed counts as infinite, and those of which one arm made a fault (too fast, in a light
joint) are left out of both. `drop` is that of the tool of a raised arm, at most: in the two seconds
after it was switched off in order, and in the five after its daemon was killed while it held, with
the guardian and, to compare, without.
"""

import math
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from bench.follow import percentile
from bench.options import SEED, command
from bench.report import Target, print_report
from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.lockstep import OPENARM, ROMEO, Rig, lockstep_rig
from common.arrays import Vector
from daemon.config.schema import frames_of
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import Go
from daemon.service.poses import Poses
from drivers.can.load import bus_load

#: Share of the way to a limit that a raised joint goes, and no more [rad].
RAISED_SHARE, RAISED_RAD = 0.5, 0.9
REST_S, TOUCH_S = (3.0, 4.5), 0.6
QUIET_S = 60.0


@contextmanager
def canopen_twin(folder: Path) -> Iterator[Path]:
    """The same arm with the CANopen drives of configs/romeo_left_arm, in a folder of its own."""
    profiles = re.search(r"^drives:.*?(?=^\S)", (ROMEO / "config.yaml").read_text(), re.M | re.S)
    assert profiles
    name = re.findall(r"^  (\w+):", profiles[0], re.M)[0]
    with tempfile.TemporaryDirectory() as made:
        twin = Path(made) / folder.name
        shutil.copytree(folder, twin)
        shutil.copy(ROMEO / "drive.eds", twin)
        text = (twin / "config.yaml").read_text()
        text = re.sub(r"^drives:.*?(?=^joints:)", profiles[0], text, flags=re.M | re.S)
        text = re.sub(r"profile: \w+", f"profile: {name}", text)
        # Currents are in thousandths of what is rated, which must reach what is allowed.
        rated = r"rated_current_A: [\d.]+, max_current_A: ([\d.]+)"
        (twin / "config.yaml").write_text(re.sub(rated, _half_rated, text))
        plant = (twin / "simulation.yaml").read_text()
        plant = re.sub(r"^joints:.*", "", plant, flags=re.M | re.S).replace("urdf: arm.urdf\n", "")
        (twin / "simulation.yaml").write_text(plant)
        yield twin


def _half_rated(found: re.Match[str]) -> str:
    most = float(found[1])
    return f"rated_current_A: {most / 2:g}, max_current_A: {most:g}"


@dataclass(frozen=True, slots=True)
class Found:
    """Detections of an arm."""

    level: Vector  # in force, median in motion (n,) [Nm]
    delays_s: Vector  # of the touches; infinite where one was missed, NaN where it was a fault
    false: int  # contacts while nothing touched it
    load: float  # share of the bus


def detects(folder: Path, touches: int, seed: int) -> Found:
    """An arm in motion, and touches of its joints, one after the other."""
    random = np.random.default_rng(seed)
    levels, delays, false = list[Vector](), list[float](), 0
    while len(delays) < touches:
        with lockstep_rig(folder) as rig:
            rig.enable()
            rig.request(Event.START)
            assert rig.permit() == []
            c = rig.robot.configuration
            rig.run(3.0)
            for _ in range(0 if levels else round(QUIET_S / c.period_s)):
                rig.step()
                levels.append(rig.estimate.threshold.copy())
                false += rig.mode is Mode.ADMITTANCE and rig.last.decision is not None
            for joint in range(len(delays) % rig.arm.plant.n, rig.arm.plant.n):
                if len(delays) < touches and rig.mode is not Mode.FAULTED:
                    delays.append(_delay(rig, joint, random))
    load = bus_load(frames_of(c), c.bus.bitrate)
    return Found(np.median(levels, axis=0), np.array(delays), false, load)


def missed(found: Found) -> int:
    """Number of touches that an arm did not yield to."""
    return int(np.isinf(found.delays_s).sum())


def _ratio(ours: float, theirs: float) -> float:
    """NaN where neither is known."""
    return ours / theirs if math.isfinite(theirs) else math.nan


def _delay(rig: Rig, joint: int, random: np.random.Generator) -> float:
    rig.run(random.uniform(*REST_S))
    for _ in range(1000):
        if tracks := rig.mode is Mode.TRACKING:
            break
        rig.step()
    if rig.mode is Mode.FAULTED:
        return math.nan
    if not tracks:
        raise click.ClickException(f"{rig.robot.path}: {rig.tick.controller.machine.cause}")
    period_s = rig.robot.configuration.period_s
    torque = 2.0 * rig.estimate.threshold[joint] * random.choice((-1.0, 1.0))
    within = random.uniform()
    # It begins within a tick, of which it has this share.
    rig.arm.external_torque[joint] = torque * within
    rig.step()
    rig.arm.external_torque[joint] = torque
    delay = math.inf
    for k in range(round(TOUCH_S / period_s)):
        if rig.mode is Mode.ADMITTANCE:
            delay = (k + within) * period_s
            break
        if rig.tick.controller.faulted:
            delay = math.nan
            break
        rig.step()
    rig.arm.external_torque[:] = 0.0
    return delay


def _raised(rig: Rig) -> None:
    """Hold each joint part of the way to its further limit."""
    limits = {joint.name: joint.limits for joint in rig.robot.configuration.joints}
    there = {}
    for name, limit in limits.items():
        way = limit.upper if limit.upper > -limit.lower else limit.lower
        there[name] = math.copysign(min(abs(way) * RAISED_SHARE, RAISED_RAD), way)
    rig.enable()
    path = Poses(rig.robot).path(Go(targets=there), rig.samples.link_position)
    assert not rig.tick.controller.request(Event.START, "the bench", rig.time_s, path)
    rig.run(12.0)
    assert rig.mode is Mode.HOLDING, rig.mode


def _drop(rig: Rig, seconds: float, step: Callable[[], None]) -> float:
    """Furthest way of the tool in so many seconds [m]."""
    begun, furthest = rig.arm.plant.q.copy(), 0.0
    J = rig.robot.model.tool_jacobian(begun)
    for _ in range(round(seconds / rig.robot.configuration.period_s)):
        step()
        furthest = max(furthest, float(np.linalg.norm(J @ (rig.arm.plant.q - begun))))
    return furthest


def drops(folder: Path) -> dict[str, float]:
    """Drop of the tool of a raised arm [m], by what happens to it."""
    found: dict[str, float] = {}
    for what in ("switched off", "killed", "killed, no guardian"):
        with lockstep_rig(folder) as rig:
            _raised(rig)
            guard = rig.guard
            assert isinstance(guard, GuardianAtBus)
            guard.killed = what == "killed, no guardian"
            if what == "switched off":
                rig.request(Event.DISABLE)
                found[what] = _drop(rig, 2.0, rig.step)
                continue

            def alone(rig: Rig = rig) -> None:
                rig.arm.advance(rig.arm.now + rig.robot.configuration.period_s)
                rig.guard()
                rig.lockstep.pump()

            found[what] = _drop(rig, 5.0, alone)
    return found


@command(__doc__)
@click.option("--arm", type=click.Path(exists=True, path_type=Path), default=OPENARM)
@click.option("--touches", type=click.IntRange(min=7), default=105)
@SEED
def main(arm: Path, touches: int, seed: int, as_json: bool) -> None:
    ours = detects(arm, touches, seed)
    with canopen_twin(arm) as twin:
        theirs = detects(twin, touches, seed)
    fell = drops(arm)
    ratio = ours.level / theirs.level
    both = ~np.isnan(ours.delays_s + theirs.delays_s)
    targets = [
        Target("touches missed, no more than with CANopen", missed(ours), missed(theirs)),
        Target("ticks in a false contact", ours.false, 0),
        Target("level over that with CANopen, worst joint", float(ratio.max()), 1.25),
        *(
            Target(
                f"delay over that with CANopen, p{share}",
                _ratio(*(percentile(each.delays_s[both], share) for each in (ours, theirs))),
                1.25,
            )
            for share in (50, 95)
        ),
        Target("load of the bus", ours.load, 0.6),
        Target("drop of the tool, switched off", 100 * fell["switched off"], 2, "cm"),
        Target("drop of the tool, daemon killed", 100 * fell["killed"], 5, "cm"),
    ]
    data: dict[str, Any] = {
        name: {
            "level_Nm": each.level,
            "missed": missed(each),
            "faults": int(np.isnan(each.delays_s).sum()),
            "p50_ms": 1e3 * percentile(each.delays_s[both], 50),
            "p95_ms": 1e3 * percentile(each.delays_s[both], 95),
            "bus_load": each.load,
        }
        for name, each in ((arm.name, ours), ("with CANopen", theirs))
    }
    data["drop_cm"] = {what: 100 * metres for what, metres in fell.items()}
    print_report("makes", seed, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
