"""Simulated arms on a guide: deviation under a push across it, and the force of a lead along it.

A line along an axis of the tool. 20 N press across it, along each held axis that the drives can
withstand; then a hand leads the tool to and fro, with the guide and without; then an obstacle is
on the way of the spring, in place of the hand.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.study import wrench
from bench.study.hands import Hands
from bench.study.leading import DAMPING_S, Hand, arm_at_work, robot_of, yields
from common.arrays import Matrix, Vector
from daemon.config.vectors import row
from daemon.modes.table import Event, Mode
from daemon.protocol.guide import AXES, GuideAxes

ARMS: Final = ("romeo", "openarm", "beam")
ACROSS_N, RISES_N_S, STAYS_S, SETTLED_S = 20.0, 10.0, 1.5, 0.5
STRENGTH: Final = 0.8  # of the motors, gravity included
MM: Final = 1e3
HAND_N_M, SPEED_M_S, WAY_M, RESTS_S = 1500.0, 0.05, 0.1, 60.0
OBSTACLE_N_M, BACK_M, GAP_M, BLOCKED_S = 20_000.0, 0.025, 0.0005, 6.0


@dataclass(frozen=True, slots=True)
class Guided:
    """One arm and line; deviations from it [mm], for a push along each held axis, NaN if the drives
    cannot withstand it, and for a lead; play of the gaps likewise; forces of a lead [N]."""

    arm: str
    seed: int
    line: str
    fault: str = ""  # that ended the run; later figures are NaN
    off: tuple[float, ...] = (np.nan,)  # settled
    furthest: tuple[float, ...] = (np.nan,)  # while the force rises, too
    play: tuple[float, ...] = (np.nan,)
    led_off: float = np.nan
    free_off: float = np.nan  # without the guide
    leads: float = np.nan
    leads_free: float = np.nan
    pressed: tuple[float, ...] = ()  # an obstacle, for each held axis, at most [N]
    still_pressed: tuple[float, ...] = ()  # after BLOCKED_S


def guided(arm: str, seed: int, work_s: float) -> Guided:
    """Figures for one of ARMS, with Romeo's drives, after `work_s` of work."""
    with TemporaryDirectory() as folder:
        robot = robot_of(wrench.robot_of(arm, Path(folder)))
        line, way = "xyz"[seed % 3], 1.0 - 2.0 * (seed // 3 % 2)
        held = tuple(axis for axis in AXES[:3] if axis != line)
        guide, k = GuideAxes(stiff=(*held, *AXES[3:])), "xyz".index(line)
        found = Guided(arm, seed, line)
        try:
            on = arm_at_work(robot, seed, work_s)
            on.request(Event.PAUSE)
            pushed = [across(on, guide, AXES.index(axis), way) for axis in held]
            off, furthest, play = zip(*pushed, strict=True)
            found = replace(found, off=off, furthest=furthest, play=play)
            led = [along(on, guide, k, way) for way in (1.0, -1.0)]
            free = [along(on, GuideAxes(), k, way) for way in (1.0, -1.0)]
            (leads, led_off), (leads_free, free_off) = np.transpose(led), np.transpose(free)
            found = replace(
                found,
                led_off=float(led_off.max()),
                free_off=float(free_off.max()),
                leads=float(np.median(leads)),
                leads_free=float(np.median(leads_free)),
            )
            at_obstacles = [blocked(on, guide, AXES.index(axis), way) for axis in held]
            pressed, still_pressed = zip(*at_obstacles, strict=True)
            return replace(found, pressed=pressed, still_pressed=still_pressed)
        except RuntimeError as error:
            return replace(found, fault=str(error))


def _rest(on: ArmInTheLoop, axes: GuideAxes) -> Hands:
    """Let the arm hold, armed, and set a guide."""
    on.drives.hold, since_s = None, on.time_s
    while on.mode is not Mode.HOLDING:
        on.step()
        if on.time_s > since_s + RESTS_S:
            raise RuntimeError(f"{on.mode}: {on.tick.controller.machine.cause}")
    if reasons := on.permit() or on.tick.controller.leading.set_guide(axes, "the bench"):
        raise RuntimeError("; ".join(reasons))
    return Hands(on.robot.model, on.robot.urdf)


def across(on: ArmInTheLoop, axes: GuideAxes, axis: int, way: float) -> tuple[float, float, float]:
    """Deviation of the tool along an axis that is pushed, from where it held, in the end and at
    most, and the play of the gaps there [mm]."""
    at_tool, plant, c = _rest(on, axes).at_tool, on.harness.plant, on.robot.configuration
    x, J = at_tool(plant.q)
    ahead: Vector = way * on.robot.model.axes(plant.q)[:, axis]
    play = 2.0 * float(np.abs(ahead @ J) @ row(c, lambda j: j.half_gap))
    strongest = row(c, lambda j: j.torque_constant * j.wiring.max_current_A)
    torque = np.abs(J.T @ ahead * ACROSS_N) + np.abs(on.robot.model.gravity(plant.q))
    if (torque > STRENGTH * strongest).any():
        return np.nan, np.nan, MM * play
    force, offs = 0.0, []
    on.drives.hold = lambda q, _: at_tool(q)[1].T @ (force * ahead)
    for _ in range(round((ACROSS_N / RISES_N_S + STAYS_S) / on.period_s)):
        force = min(force + RISES_N_S * on.period_s, ACROSS_N)
        on.step()
        offs.append(abs(float(ahead @ (at_tool(plant.q)[0] - x))))
    settled = float(np.median(offs[-round(SETTLED_S / on.period_s) :]))
    return MM * settled, MM * max(offs), MM * play


def along(on: ArmInTheLoop, axes: GuideAxes, axis: int, way: float) -> tuple[float, float]:
    """Force [N] of a hand that leads the tool along its axis and is free across it, median over the
    second half of the motion, and largest deviation of the tool from that line [mm]."""
    at_tool, plant = _rest(on, axes).at_tool, on.harness.plant
    x, _ = at_tool(plant.q)
    ahead: Vector = way * on.robot.model.axes(plant.q)[:, axis]

    def place(q: Vector) -> tuple[Vector, Matrix]:
        point, J = at_tool(q)
        return np.array([ahead @ point]), (ahead @ J)[np.newaxis]

    speed, none = np.array([SPEED_M_S]), np.zeros(1)
    hand = Hand(place, HAND_N_M, ACROSS_N, place(plant.q)[0], speed, none, DAMPING_S * HAND_N_M)
    on.drives.hold, forces, off = hand, [], 0.0
    for _ in range(round(WAY_M / SPEED_M_S / on.period_s)):
        on.step()
        if yields(on):
            gone = at_tool(plant.q)[0] - x
            off = max(off, float(np.linalg.norm(gone - ahead * (ahead @ gone))))
        forces.append(float(hand.force[0]))
    return float(np.median(forces[len(forces) // 2 :])), MM * off


def blocked(on: ArmInTheLoop, axes: GuideAxes, axis: int, way: float) -> tuple[float, float]:
    """Force [N] on an obstacle that takes the place of a hand, on the way of the tool back to a
    guide BACK_M away: at most, and in the end. NaN if the arm does not yield to the hand."""
    at_tool, plant = _rest(on, axes).at_tool, on.harness.plant
    ahead: Vector = way * on.robot.model.axes(plant.q)[:, axis]
    force, forces = 0.0, [0.0]
    on.drives.hold = lambda q, _: at_tool(q)[1].T @ (force * ahead)
    while not (yields(on) and force > STRENGTH * ACROSS_N):
        force += RISES_N_S * on.period_s
        on.step()
        if force > 2.0 * ACROSS_N:
            return np.nan, np.nan
    (x, J), guidance = at_tool(plant.q), on.tick.controller.motion.guidance
    guidance.forget()
    guidance.begin(plant.q - np.linalg.pinv(J) @ (BACK_M * ahead))

    def obstacle(q: Vector, _: Vector) -> Vector:
        point, J = at_tool(q)
        forces.append(OBSTACLE_N_M * max(float(ahead @ (x - point)) - GAP_M, 0.0))
        torque: Vector = J.T @ (forces[-1] * ahead)
        return torque

    on.drives.hold = obstacle
    on.run(BLOCKED_S)
    return max(forces), forces[-1]
