"""Changes of an arm's physics that the model lacks and nothing was tuned on: three of CHANGES are
drawn by a seed. Each begins with the day, and acts on the plant at every tick."""

from collections.abc import Callable
from typing import Final

import numpy as np

from bench.rigs.arm_without_bus import Act, Harness
from common.arrays import Vector


def sag(rng: np.random.Generator, level: Vector) -> Act:
    """Torque constants that decrease by 3 to 8 % as magnets warm."""
    share = rng.uniform(0.03, 0.08, len(level))
    cold: list[Vector] = []

    def act(harness: Harness, t: float) -> Vector:
        constant = harness.parameters.torque_constant
        if not cold:
            cold.append(constant.copy())
        constant[:] = cold[0] * (1.0 - share * (1.0 - np.exp(-t / 600.0)))
        return np.zeros_like(level)

    return act


def tilt(rng: np.random.Generator, level: Vector) -> Act:
    """Base that tilts by 1 to 3 degrees to one side, within five minutes."""
    angle, side = np.radians(rng.uniform(1.0, 3.0)), rng.uniform(0.0, 2.0 * np.pi)

    def act(harness: Harness, t: float) -> Vector:
        a = angle * min(t / 300.0, 1.0)
        sine = np.sin(a) * np.array([np.cos(side), np.sin(side)])
        harness.plant.weigh(-9.81 * np.array([*sine, np.cos(a)]))
        return np.zeros_like(level)

    return act


def swing(rng: np.random.Generator, level: Vector) -> Act:
    """Unannounced load of 30 to 80 g that swings by 20 degrees on 0.1 to 0.3 m in the hand's frame,
    independently of the arm."""
    mass, length = rng.uniform(0.03, 0.08), rng.uniform(0.1, 0.3)

    def act(harness: Harness, t: float) -> Vector:
        angle = 0.35 * np.sin(np.sqrt(9.81 / length) * t)
        harness.plant.carry(mass, length * np.array([np.sin(angle), 0.0, -np.cos(angle)]))
        return np.zeros_like(level)

    return act


def cable(rng: np.random.Generator, level: Vector) -> Act:
    """Cable along each joint, a spring with hysteresis that slips at 20 to 60 % of the level."""
    most, reach = rng.uniform(0.2, 0.6, len(level)) * level, rng.uniform(0.1, 0.4, len(level))
    before: list[Vector] = []
    bent = np.zeros_like(level)

    def act(harness: Harness, t: float) -> Vector:
        del t
        q = np.array(harness.plant.q)
        bent[:] = np.clip(bent + q - (before.pop() if before else q), -reach, reach)
        before.append(q)
        return -most * bent / reach

    return act


def wear(rng: np.random.Generator, level: Vector) -> Act:
    """Gaps that grow by 10 to 60 % in twenty minutes."""
    share = rng.uniform(0.1, 0.6, len(level))

    def act(harness: Harness, t: float) -> Vector:
        new = harness.parameters.half_gap * (1.0 + share * min(t / 1200.0, 1.0))
        np.asarray(harness.plant.masses.half_gap)[:] = new
        return np.zeros_like(level)

    return act


CHANGES: Final[dict[str, Callable[[np.random.Generator, Vector], Act]]] = {
    change.__name__: change for change in (sag, tilt, swing, cable, wear)
}


def drawn(seed: int) -> list[str]:
    """Names of three random changes."""
    return sorted(
        np.random.default_rng((seed, 90)).choice(list(CHANGES), 3, replace=False).tolist()
    )
