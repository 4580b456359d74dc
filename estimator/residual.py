# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Momentum residuals: first-order estimates of the external torque, (2), (12) and (13).

All variants share one form. Over an interval T the momentum of the links changes by the impulses
that act on them, and the remainder is the impulse of the external torque:

    e(k) = Delta(M q_dot) - T beta - T tau_L + T tau_mu
    r(k) = [(2 - T K) r(k-1) + 2 K e(k)] / (2 + T K)

which is (13) by increments: no integral grows, and r starts from 0 whatever the momentum. The
rotor's B theta_ddot enters as the increment B Delta theta_dot, so that nothing is differentiated
twice; `interval` computes increments and integrals.

An interval counts as in the gap only if the joint is in the gap at both ends. If the rotor meets
the link within an interval, tau_M, friction and B Delta theta_dot of the whole interval belong
together: the momentum that the rotor gained in the gap is what it gives to the link.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from common.arrays import Matrix, Vector
from common.errors import ModelError
from estimator.interval import ROW
from estimator.settings import Kind, Variant

_SHORTEST_S = 1e-9
_TERMS = len(ROW)

Form = Mapping[str, float]
"""Weights by name of a sum of `interval.TERMS`."""

# Terms of e besides momentum and beta, by kind: drive, friction and rotor inertia; each split into
# those that always act, and those that act only while engaged.
_TERMS_OF: dict[Kind, tuple[tuple[Form, Form], tuple[Form, Form], tuple[Form, Form]]] = {
    "classical": (
        ({"tau_M": -1.0}, {}),
        ({"motor_friction": 1.0, "engaged_link_friction": 1.0, "stiction": 1.0}, {}),
        ({"rotor": 1.0}, {}),
    ),
    "backlash": (
        ({}, {"tau_M": -1.0}),  # (5): tau_L = tau_M while engaged, 0 inside the gap
        (  # (6): K_theta while engaged; K_phi and K_q inside the gap
            {"link_friction": 1.0, "gap_friction": 1.0},
            {
                **{"motor_friction": 1.0, "engaged_link_friction": 1.0, "stiction": 1.0},
                **{"link_friction": -1.0, "gap_friction": -1.0},
            },
        ),
        ({}, {"rotor": 1.0}),
    ),
    "two_mass": (
        ({"tau_M": -1.0}, {}),
        ({"motor_friction": 1.0, "link_friction": 1.0, "stiction": 1.0}, {}),
        ({"rotor": 1.0}, {}),
    ),
}


def forms(variant: Variant) -> tuple[Form, Form]:
    """Terms of e(k) of a variant: those that always count, and those that count while engaged."""
    drive, friction, rotor = _TERMS_OF[variant.kind]
    parts = [drive, *[friction] * variant.friction, *[rotor] * variant.rotor_inertia]
    always: dict[str, float] = {"momentum": 1.0, "beta": -1.0}
    engaged: dict[str, float] = {}
    for acts, acts_engaged in parts:
        always.update(acts)
        engaged.update(acts_engaged)
    return always, engaged


def _weights(variants: Sequence[Variant]) -> tuple[Matrix, Matrix, Vector]:
    """Weights of `interval.TERMS` in each variant's e(k), always and while engaged, each (variants,
    TERMS); and (variants,) 1 for variants with engagement, whose tau_M is corrected."""
    tables = np.zeros((2, len(variants), _TERMS))
    for row, variant in enumerate(variants):
        for table, form in zip(tables, forms(variant), strict=True):
            for name, weight in form.items():
                table[row, ROW[name]] = weight
    corrected = np.array([float(variant.engages) for variant in variants])
    return tables[0], tables[1], corrected


class Residual:
    """Residual variants computed from the same impulses: `values` (variants, n) [Nm], and
    `corrected` by what was learned.

    Raises ModelError for gain * period >= 2, where the pole of (13) would be negative and the
    residual would ring, and for duplicate or contradictory variants.
    """

    def __init__(self, variants: Sequence[Variant], gain: float, period_s: float, n: int) -> None:
        if not 0.0 < gain * period_s < 2.0:
            raise ModelError(f"residual gain {gain} /s at {period_s} s: gain * period must be < 2")
        names = [variant.name for variant in variants]
        if len(set(names)) != len(names):
            raise ModelError(f"residuals must have different names: {', '.join(names)}")
        if any(v.kind == "two_mass" and not v.rotor_inertia for v in variants):
            raise ModelError("a two_mass residual without rotor inertia has only one mass")
        self._gain, self._variants = gain, len(names)
        self.pole = self.share = 0.0  # of the last step
        self._always, self._engaged, self._corrected = _weights(variants)
        self.values, self.corrected = np.zeros((2, len(names), n))

    def step(self, i: int, impulse: Vector, spring: float, touched: bool, dt: float) -> None:
        """Advance joint i by one interval of dt > 0 [s].

        impulse: of `interval.TERMS`; spring: impulse of the fitted correction of tau_M while
        engaged, (5) [Nm s]; touched: False if rotor and link were apart all the time. For dt beyond
        2 / gain the pole is clamped at zero: the residual is then the mean external torque of the
        interval.
        """
        TK = self._gain * dt
        # At TK = 2 the share is 1 / dt; beyond, pole and share stay there.
        self.pole = pole = max((2.0 - TK) / (2.0 + TK), 0.0)
        self.share = share = min(2.0 * self._gain / (2.0 + TK), 1.0 / max(dt, _SHORTEST_S))
        for k in range(self._variants):
            e, engaged = 0.0, -self._corrected[k] * spring  # (12) over the interval
            for row in range(_TERMS):
                e += self._always[k, row] * impulse[row]
                engaged += self._engaged[k, row] * impulse[row]
            if touched:
                e += engaged
            self.values[k, i] = pole * self.values[k, i] + share * e  # (13)
            self.corrected[k, i] = self.values[k, i]

    def reset(self, i: int) -> None:
        """Forget the external torque on joint i: r = 0."""
        for k in range(self._variants):
            self.values[k, i] = self.corrected[k, i] = 0.0

    def correct(self, i: int, correction: float) -> None:
        """Subtract the learned torque [Nm] from the residual of joint i that decides."""
        for k in range(self._variants):
            self.corrected[k, i] = self.values[k, i]
        self.corrected[0, i] -= correction

    def sum(self, i: int) -> float:
        """Sum of the values of joint i: finite if they all are."""
        total = 0.0
        for k in range(self._variants):
            total += self.values[k, i]
        return float(total)
