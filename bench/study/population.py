"""Motions and pushes for arms of a population, drawn from a seed."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from bench.rigs.arm_without_bus import Motion, Push
from bench.study.courses import Room
from common.arrays import Matrix, Vector
from daemon.config.schema import Configuration

DISPLACEMENT_M: Final = 0.005
LATENCY_MS: Final = 1.0  # largest, of the link encoder; unknown to the model
VELOCITY_SCALE_ERROR: Final = 0.002
VELOCITY_BIAS: Final = 0.001  # [rad/s], 0.02 % of 5 rad/s; both of velocities that are integrated

STEP_MS: Final = 500


def velocity_errors(rng: np.random.Generator) -> dict[str, float]:
    """Errors of the motor velocity, for SimulationSettings, with a random sign each."""
    of_scale, of_bias = rng.choice((-1.0, 1.0), 2).tolist()
    return {
        "velocity_scale_error": of_scale * VELOCITY_SCALE_ERROR,
        "velocity_bias": of_bias * VELOCITY_BIAS,
    }


def motion(
    configuration: Configuration,
    seed: int,
    *,
    go_s: float = np.inf,
    rest_s: float = 0.0,
    held: float = 0.15,
) -> Motion:
    """Sinusoids around a random pose, within joint limits and velocities; held: share of the joints
    at rest."""
    rng, room = np.random.default_rng((seed, 11)), Room.of(configuration)
    n = len(configuration.joints)
    omega = 2.0 * np.pi * rng.uniform(0.08, 0.4, n)
    reach = np.minimum(0.4 * (room.upper - room.lower), room.fastest / omega)
    amplitude = np.minimum(reach, 0.5) * rng.uniform(0.4, 1.0, n)
    amplitude[rng.random(n) < held] = 0.0
    return Motion(
        home=rng.uniform(room.lower + amplitude, room.upper - amplitude),
        amplitude=amplitude,
        omega=omega,
        phase=rng.uniform(0.0, 2.0 * np.pi, n),
        go_s=go_s,
        rest_s=rest_s,
    )


@dataclass(frozen=True, slots=True)
class Step:
    """Push on a single joint by `torque` [Nm] for STEP_MS."""

    joint: int
    torque: float
    onset_ms: int


def sizes(configuration: Configuration) -> Matrix:
    """Smallest, middle and largest step for each joint [Nm], (3, n): a tenth, twice and eight times
    its threshold, but no more than its drive can hold."""
    joints = configuration.joints
    contact = np.array([joint.thresholds.contact for joint in joints])
    strength = np.array([joint.torque_constant * joint.wiring.max_current_A for joint in joints])
    return np.array([0.1 * contact, 2.0 * contact, np.minimum(8.0 * contact, 0.8 * strength)])


def steps(
    configuration: Configuration, seed: int, onsets_ms: list[int], usual: Vector
) -> list[Step]:
    """Steps, one at each onset, over the joints in turn: one third has the joint's `usual` size
    (n,) [Nm], one third a random smaller one, one third a random larger one, within `sizes`."""
    rng = np.random.default_rng((seed, 12))
    smallest, middle, largest = sizes(configuration)
    n = len(configuration.joints)
    order = np.concatenate([rng.permutation(n) for _ in range(len(onsets_ms) // n + 1)])
    drawn = []
    for joint, onset_ms in zip(order.tolist(), onsets_ms, strict=False):
        u = rng.random()
        size = (
            usual[joint],
            smallest[joint] * (middle[joint] / smallest[joint]) ** u,
            middle[joint] * (largest[joint] / middle[joint]) ** u,
        )[rng.integers(3)]
        drawn.append(Step(joint, float(size * rng.choice((-1.0, 1.0))), onset_ms))
    return drawn


def pushes(drawn: list[Step], n: int) -> tuple[Push, ...]:
    """The steps as external torque of `n` joints."""
    return tuple(
        Push(step.onset_ms, STEP_MS, step.torque * np.eye(n)[step.joint]) for step in drawn
    )


def onsets_in_motion(seconds: float, seed: int) -> list[int]:
    """Onsets [ms] about every one and a half seconds, at any time between two SYNCs."""
    rng = np.random.default_rng((seed, 13))
    return [int(1000 * t + rng.integers(200)) for t in np.arange(3.0, seconds - 1.0, 1.5)]


GO_S, REST_S = 5.0, 8.0  # motion before a rest, which determines friction


def onsets_at_rest(seconds: float, seed: int) -> list[int]:
    """Onsets [ms], three in every rest of GO_S and REST_S."""
    rng = np.random.default_rng((seed, 14))
    begins = np.arange(GO_S, seconds - REST_S + 1e-9, GO_S + REST_S)
    return [
        int(1000 * (begin + after) + rng.integers(300))
        for begin in begins
        for after in (1, 3.3, 5.6)
    ]
