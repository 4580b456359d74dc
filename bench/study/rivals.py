"""Rivals of the product's residuals: the Kalman disturbance observer, and recurrent networks.

The observer: per joint, with p the momentum, u all torques of the model, d the external one:

    p_dot = u + d        d_dot = w        measured: p + v

w and v are white; only the ratio of their intensities matters, so all joints have the same gain.
Its model is that of `classical` with friction and rotor inertia, without a gap: only the filter
differs. Its steady gain has a closed form (the tracking index; P. Kalata, 1984), and one parameter,
which `fair_index` sets so that white torque passes it as much as the product's residual of gain K.

A recurrent network learns a torque y of contact-free motion from the previous samples, without the
current, in which a hand would show; its residual is y minus its prediction. y, filtered by the gain
K, is the negative motor torque (`gru`), or the residual of KALMAN_BELIEF (`gru+momentum`, after D.
Lim, D. Kim and J. Park, "Momentum observer-based collision detection using LSTM for model
uncertainty learning", 2021).
"""

import copy
import importlib
import math
import sys
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from common.arrays import Matrix, Vector

KALMAN: Final = "kalman"
KALMAN_BELIEF: Final = "classical+friction+rotor"  # also the observer's model


def fair_index(TK: float) -> float:
    """Tracking index at which d has the noise bandwidth of the residual (13) with T K = `TK`.

    White torque of variance 1 per tick leaves the residual with TK / 2. The steady observer is
    d(k) = (2 - a - b) d(k-1) - (1 - a) d(k-2) + b u(k) and leaves b (2 - a) / (a (4 - 2 a - b));
    with r = sqrt(1 - a) and the Kalman gain's b = 2 (1 - r)^2, both are equal at the root of a
    cubic. For T K << 1 that is a Butterworth filter of sqrt(2) K.
    """
    roots = np.roots([1.0, TK - 1.0, TK + 1.0, -1.0])
    r = next(float(root.real) for root in roots if abs(root.imag) < 1e-9 and 0.0 < root.real < 1.0)
    return 2.0 * (1.0 - r) ** 2 / r


class KalmanObserver:
    """Observer for n joints, starting without external torque; its gain converges by itself.

    index: T^2 sigma_w / sigma_v for samples `period` [s] apart.
    """

    def __init__(self, n: int, index: float, period: float) -> None:
        self._noise = (index / period**2) ** 2  # sigma_w^2 for sigma_v = 1
        self._ahead = np.zeros(n)  # measured minus estimated p [Nm s]
        self._torque = np.zeros(n)
        self._covariance = np.array([[1.0, 0.0], [0.0, 0.0]])  # of p and d, for sigma_v = 1

    def step(self, unexplained: Vector, dt: float) -> Vector:
        """External torque d (n,) [Nm].

        unexplained: change of momentum in the last dt [s] that u does not explain, (n,) [Nm s].
        """
        F, G = np.array([[1.0, dt], [0.0, 1.0]]), np.array([0.5 * dt * dt, dt])
        P = F @ self._covariance @ F.T + self._noise * np.outer(G, G)
        gain = P[:, 0] / (P[0, 0] + 1.0)
        self._covariance = P - np.outer(gain, P[0])
        innovation = self._ahead + unexplained - dt * self._torque
        self._ahead = (1.0 - gain[0]) * innovation
        self._torque = self._torque + gain[1] * innovation
        return self._torque


def kalman(residual: Matrix, K: float, period_s: float) -> Matrix:
    """The observer's torque [Nm], from the residual of KALMAN_BELIEF (ticks, n) starting at r = 0.

    The unexplained impulse of each interval is (13) inverted: 2 K e = (2 + T K) r - (2 - T K) r'.
    """
    TK = K * period_s
    before = np.vstack((np.zeros_like(residual[:1]), residual[:-1]))
    unexplained = ((2.0 + TK) * residual - (2.0 - TK) * before) / (2.0 * K)
    observer = KalmanObserver(residual.shape[1], fair_index(TK), period_s)
    return np.array([observer.step(e, period_s) for e in unexplained])


@dataclass(frozen=True, slots=True)
class Recipe:
    """Training of a network: Adam with cosine annealing. The epoch counts that is best on the last
    fifth of the motion, which is held out."""

    hidden: int = 64
    window: int = 200  # ticks
    unscored: int = 50  # of them
    batch: int = 48
    dropout: float = 0.3
    rate: float = 1e-3
    epochs: int = 60


def torch() -> Any:
    """PyTorch, an optional dependency; exits if it is not installed."""
    try:
        return importlib.import_module("torch")
    except ImportError:
        sys.exit("bench.rivals needs PyTorch, which is not installed: pip install '.[rivals]'")


def seen_by_network(samples: Matrix, period_s: float) -> Matrix:
    """Inputs (ticks, 6 n) from samples (ticks, 4, n): sine and cosine of the link position, motor
    minus link position, velocities of link and motor, acceleration of the motor; no current."""
    _, q, velocity, theta = np.moveaxis(samples, 1, 0)
    q_dot, acceleration = (np.diff(x, axis=0, prepend=x[:1]) / period_s for x in (q, velocity))
    return np.hstack((np.sin(q), np.cos(q), theta - q, q_dot, velocity, acceleration))


class Recurrent:
    """GRU and linear layer that predict a torque (ticks, n) [Nm] from inputs (ticks, m)."""

    def __init__(self, inputs: Matrix, torque: Matrix, seed: int, recipe: Recipe) -> None:
        self._torch = torch()
        self._torch.manual_seed(seed)
        self._torch.set_num_threads(1)  # a result must not depend on the number of processors
        self._scales = [(x.mean(axis=0), x.std(axis=0) + 1e-9) for x in (inputs, torque)]
        self._gru = self._torch.nn.GRU(inputs.shape[1], recipe.hidden, batch_first=True)
        self._out = self._torch.nn.Linear(recipe.hidden, torque.shape[1])
        self._train(self._scaled(inputs, 0), self._scaled(torque, 1), seed, recipe)

    def _train(self, x: Any, y: Any, seed: int, recipe: Recipe) -> None:
        split, rng, least = len(x) * 4 // 5, np.random.default_rng(seed), math.inf
        layers = self._torch.nn.ModuleList((self._gru, self._out))
        optimiser = self._torch.optim.Adam(layers.parameters(), recipe.rate)
        falls = self._torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, recipe.epochs)
        for _ in range(recipe.epochs):
            first = rng.integers(recipe.window)
            begins = rng.permutation(np.arange(first, split - recipe.window, recipe.window))
            for k in range(0, len(begins), recipe.batch):
                rows = begins[k : k + recipe.batch, np.newaxis] + np.arange(recipe.window)
                kept = self._torch.nn.functional.dropout(self._gru(x[rows])[0], recipe.dropout)
                optimiser.zero_grad()
                (self._out(kept) - y[rows])[:, recipe.unscored :].square().mean().backward()
                optimiser.step()
            falls.step()
            with self._torch.no_grad():
                error = self._out(self._gru(x[np.newaxis, split:])[0])[0] - y[split:]
            if (loss := float(error.square().mean())) < least:
                least, best = loss, copy.deepcopy(layers.state_dict())
        layers.load_state_dict(best)

    def _scaled(self, values: Matrix, which: int) -> Any:
        mean, width = self._scales[which]
        return self._torch.tensor((values - mean) / width, dtype=self._torch.float32)

    def expects(self, inputs: Matrix) -> Matrix:
        """Torque (ticks, n) [Nm] of contact-free motion, predicted from the previous ticks."""
        with self._torch.no_grad():
            scaled = self._out(self._gru(self._scaled(inputs, 0)[np.newaxis])[0])[0]
        return np.asarray(
            scaled.numpy().astype(np.float64) * self._scales[1][1] + self._scales[1][0]
        )
