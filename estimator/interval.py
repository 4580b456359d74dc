"""Impulses over one interval of each joint, from the values at both of its ends.

Momenta change by an increment; torques and velocities are integrated by Tustin's rule, the mean of
both ends. Every sum of such impulses is linear in the stacked values of both ends, so all of them
come out of two matrix products, however many residuals run side by side.

A joint whose sample is missing keeps its ends, and its interval lasts until the next one comes:
nothing of what happened meanwhile is lost, or counted twice.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arrays import Matrix, Vector
from estimator import memory

# Values at an instant, one row each, in this order. Kinds of friction: see `residual`.
TERMS = (
    "momentum",  # M q_dot [kg m2/s]
    "rotor",  # B theta_dot [kg m2/s]
    "theta",  # , where it is measured [rad]
    "theta_dot",  # [rad/s]
    "beta",  # C^T q_dot - g [Nm]
    "tau_M",  # [Nm]
    "motor_friction",  # friction of the motor's side at theta_dot [Nm]
    "engaged_link_friction",  # friction of the link's side at theta_dot: rotor and link move as one
    "link_friction",  # friction of the link's side at q_dot
    "gap_friction",  # friction between rotor and link at phi_dot
    "stiction",  # what is held near rest beyond motor_friction and engaged_link_friction
)
ROW = {name: row for row, name in enumerate(TERMS)}
_INCREMENTS = frozenset({"momentum", "rotor", "theta"})

Form = Mapping[str, float]
"""A sum of terms: weight by name."""


class Interval:
    """Values at both ends and the impulses of `forms`, shape (len(forms), n), of the last step.

    Write the values of an instant to the rows of `now`, (len(TERMS), n), after `begin`; those of
    the instant before are then in `before`. Where a joint has none, `keep` takes it out again.
    """

    _MEMORY = ("_ends",)

    def __init__(self, forms: Sequence[Form], n: int) -> None:
        terms = len(TERMS)
        self._ends: Matrix = np.zeros((2 * terms, n))
        self.now, self.before = self._ends[:terms], self._ends[terms:]
        self.impulses: Matrix = np.zeros((len(forms), n))
        self._fixed, self._per_second = np.zeros((2, len(forms), 2 * terms))
        self._increments: Matrix = np.zeros((len(forms), n))
        for form, fixed, per_second in zip(forms, self._fixed, self._per_second, strict=True):
            for name, weight in form.items():
                if name in _INCREMENTS:
                    fixed[[ROW[name], terms + ROW[name]]] = weight, -weight
                else:
                    per_second[[ROW[name], terms + ROW[name]]] = 0.5 * weight

    def begin(self) -> None:
        """Make the values of now those of the interval's beginning."""
        self.before[:] = self.now

    def keep(self, joints: NDArray[np.bool_]) -> None:
        """Take back what was written of these joints (n,): their interval goes on."""
        self.now[:, joints] = self.before[:, joints]

    def start(self, joints: NDArray[np.bool_]) -> None:
        """Begin anew with these joints (n,): nothing is known of the time before now."""
        self.before[:, joints] = self.now[:, joints]

    def step(self, dt: Vector) -> Matrix:
        """Impulses over the last dt (n,) [s]; overwritten by the next step. Zero where dt is 0 and
        both ends are the same."""
        np.dot(self._per_second, self._ends, out=self.impulses)
        np.multiply(self.impulses, dt, out=self.impulses)
        np.dot(self._fixed, self._ends, out=self._increments)
        return np.add(self.impulses, self._increments, out=self.impulses)

    def restart(self, joints: NDArray[np.bool_]) -> None:
        """Forget both ends of these joints (n,)."""
        self._ends[:, joints] = 0.0

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: Mapping[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
