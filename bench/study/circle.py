"""Circle that a hand draws with the tool of a simulated arm, and the force that it needs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from bench.paper.figure import save
from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.study.hands import Hands
from bench.study.leading import DAMPING_S, STRONGEST_N, Hand, arm_at_work, robot_of, yields
from common.arrays import Matrix, Vector
from daemon.modes.table import Event, Mode

RADIUS_M, SPEED_M_S, ROUNDS, HAND_N_M = 0.06, 0.12, 1.5, 1000.0
NAMES: Final = {True: "assist", False: "no assist"}


@dataclass(frozen=True, slots=True)
class Circle:
    """One circle, a row per tick from when the arm yields: tool [m] in its plane, centred; force
    [N]."""

    place: Matrix
    force: Vector


def plane(on: ArmInTheLoop) -> Matrix:
    """The two directions (2, 3) in which the tool moves most easily."""
    J = on.robot.model.tool_jacobian(on.harness.plant.q)
    _, axes = np.linalg.eigh((J * on.tick.controller.motion.gains.value) @ J.T)
    easiest: Matrix = axes.T[:0:-1]
    return easiest


def draw_circle(on: ArmInTheLoop) -> Circle:
    """Draw a circle with the tool of an armed arm at work, which then holds."""
    on.request(Event.PAUSE)
    while on.mode is not Mode.HOLDING:
        on.step()
    plant, at_tool = on.harness.plant, Hands(on.robot.model, on.robot.urdf).at_tool
    across, along = ways = plane(on)
    x, _ = at_tool(plant.q)
    middle, angle, rows = x - RADIUS_M * across, 0.0, []
    hand = Hand(at_tool, HAND_N_M, STRONGEST_N, x, np.zeros(3), np.zeros(3), DAMPING_S * HAND_N_M)
    on.drives.hold = hand
    while angle < 2.0 * np.pi * ROUNDS:
        way = np.cos(angle) * along - np.sin(angle) * across
        hand.rate = SPEED_M_S * way
        on.step()
        angle += SPEED_M_S / RADIUS_M * on.period_s
        if yields(on):
            rows.append((*(ways @ (at_tool(plant.q)[0] - middle)), np.linalg.norm(hand.force)))
    on.drives.hold, table = None, np.array(rows)
    return Circle(table[:, :2], table[:, 2])


def circles(seed: int, work_s: float, path: Path) -> dict[str, dict[str, float]]:
    """The same circle with and without assist, after `work_s` of work, drawn to a PNG; returns
    force [N] and radius [m] of each."""
    robots = {name: robot_of(assists=assists) for assists, name in NAMES.items()}
    period_s = robots["assist"].configuration.period_s
    drawn = {name: draw_circle(arm_at_work(r, seed, work_s)) for name, r in robots.items()}
    picture(drawn, period_s, path)
    return {
        name: {
            "median_N": float(np.median(circle.force)),
            "most_N": float(circle.force.max()),
            "least_radius_m": float(np.linalg.norm(circle.place, axis=1).min()),
        }
        for name, circle in drawn.items()
    }


def picture(drawn: dict[str, Circle], period_s: float, path: Path) -> None:
    """Circles and their forces as a PNG."""
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    tool, force = figure.subplots(1, 2)
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    tool.plot(1e3 * RADIUS_M * np.cos(turn), 1e3 * RADIUS_M * np.sin(turn), "k:", label="hand")
    for name, circle in drawn.items():
        tool.plot(*(1e3 * circle.place.T), label=name)
        force.plot(period_s * np.arange(len(circle.force)), circle.force, label=name)
    tool.set(xlabel="tool [mm]", ylabel="tool [mm]", aspect="equal")
    force.set(xlabel="time [s]", ylabel="force of the hand [N]", ylim=(0.0, None))
    tool.legend(loc="center", fontsize="small")
    save(figure, path)
