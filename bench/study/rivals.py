"""Rival of the product's residuals: the Kalman disturbance observer of the momentum.

Per joint, with p the momentum, u all torques that the model has, d the external torque:

    p_dot = u + d        d_dot = w        measured: p + v

w and v are white; only the ratio of their strengths matters, so all joints have the same gain. Its
model is that of `classical` with friction and rotor inertia, without a gap: what differs is the
filter. Its steady gain has a closed form (the tracking index; P. Kalata, 1984), and one number
to tune, which `fair_index` sets so that white torque comes through as loud as through the product's
residual of gain K.
"""

from typing import Final

import numpy as np

from common.arrays import Matrix, Vector

KALMAN: Final = "kalman"
KALMAN_BELIEF: Final = "classical+friction+rotor"  # also what the observer believes


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
    """The observer for n joints, beginning with no external torque; its gain settles by itself.

    index: T^2 sigma_w / sigma_v for samples `period` [s] apart.
    """

    def __init__(self, n: int, index: float, period: float) -> None:
        self._noise = (index / period**2) ** 2  # sigma_w^2 for sigma_v = 1
        self._ahead = np.zeros(n)  # p as measured, less p as estimated [Nm s]
        self._torque = np.zeros(n)
        self._covariance = np.array([[1.0, 0.0], [0.0, 0.0]])  # of p and d, for sigma_v = 1

    def step(self, unexplained: Vector, dt: float) -> Vector:
        """The external torque d (n,) [Nm].

        unexplained: change of the momentum in the last dt [s], less what u explains, (n,) [Nm s].
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
    """The observer's torque [Nm], from the residual of KALMAN_BELIEF (ticks, n) from r = 0 on.

    What each interval won beyond belief is (13) read backwards: 2 K e = (2 + T K) r - (2 - T K) r'.
    """
    TK = K * period_s
    before = np.vstack((np.zeros_like(residual[:1]), residual[:-1]))
    unexplained = ((2.0 + TK) * residual - (2.0 - TK) * before) / (2.0 * K)
    observer = KalmanObserver(residual.shape[1], fair_index(TK), period_s)
    return np.array([observer.step(e, period_s) for e in unexplained])
