"""Momentum residuals: first-order estimates of the external torque, (2), (12) and (13).

All variants share one form. Over an interval T the momentum of the links changes by the impulses
that act on them, and what is left over is the impulse of the external torque:

    e(k) = Delta(M q_dot) - T beta - T tau_L + T tau_mu
    r(k) = [(2 - T K) r(k-1) + 2 K e(k)] / (2 + T K)

which is (13) by increments: no integral grows, and it starts from r = 0 whatever the momentum. An
interval's torques are the mean of both ends (Tustin's rule); the rotor's B theta_ddot enters as the
increment B Delta theta_dot, so that nothing is differentiated twice.

An interval counts as gap only if the joint is in the gap at both ends. When the rotor meets the
link within an interval, tau_M, friction and B Delta theta_dot of the whole interval must be taken
together: what the rotor won in the gap is what it gives to the link.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from errors import ModelError
from estimator import memory
from estimator.types import Matrix

Kind = Literal["classical", "backlash", "two_mass"]


class Variant(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One residual: what it believes about the joint. Switch parts off to show their worth."""

    kind: Kind = "backlash"
    friction: bool = True
    rotor_inertia: bool = True
    label: Annotated[str, Meta(min_length=1, max_length=64)] = ""

    @property
    def name(self) -> str:
        """The label, or what is unusual about the variant: `classical`, `backlash-rotor`."""
        if self.label:
            return self.label
        if self.kind == "classical":
            return "classical" + "+friction" * self.friction + "+rotor" * self.rotor_inertia
        return self.kind + "-friction" * (not self.friction) + "-rotor" * (not self.rotor_inertia)


# Rows of the impulses [Nm s] of one interval, shape (len(IMPULSES), n).
IMPULSES = (
    "inertial",  # Delta(M q_dot) - T beta
    "motor",  # T tau_M
    "rotor",  # B Delta theta_dot
    "rubbing",  # T tau_mu, engaged: motor and link friction at the motor's velocity
    "two_sided",  # T tau_mu: motor friction at the motor's, link friction at the link's velocity
    "engaged_motor",  # T (tau_M + correction), zero in the gap
    "engaged_rotor",  # B Delta theta_dot, zero in the gap
    "switched",  # T tau_mu of (6)
)
_ROW = {name: row for row, name in enumerate(IMPULSES)}

# Sign and name of the impulses that make up e, by kind: always, with friction, with rotor inertia.
_FORMS: dict[Kind, tuple[str, str, str]] = {
    "classical": ("motor", "rubbing", "rotor"),
    "backlash": ("engaged_motor", "switched", "engaged_rotor"),
    "two_mass": ("motor", "two_sided", "rotor"),
}


def coefficients(variant: Variant) -> list[float]:
    """e = coefficients @ impulses."""
    drive, friction, rotor = _FORMS[variant.kind]
    row = [0.0] * len(IMPULSES)
    row[_ROW["inertial"]] = 1.0
    row[_ROW[drive]] = -1.0
    row[_ROW[friction]] = float(variant.friction)
    row[_ROW[rotor]] = float(variant.rotor_inertia)
    return row


class Residual:
    """Several variants side by side on the same impulses; `values[i]` belongs to `variants[i]`.

    Raises ModelError for gain * period >= 2, where the pole of (13) would be negative and the
    residual would ring, and for variants that are alike or contradict themselves.
    """

    _MEMORY = ("values",)

    def __init__(self, variants: Sequence[Variant], gain: float, period: float, n: int) -> None:
        if not 0.0 < gain * period < 2.0:
            raise ModelError(f"residual gain {gain} /s at {period} s: gain * period must be < 2")
        names = [variant.name for variant in variants]
        if len(set(names)) != len(names):
            raise ModelError(f"residuals must have different names: {', '.join(names)}")
        for variant in variants:
            if variant.kind == "two_mass" and not variant.rotor_inertia:
                raise ModelError("a two_mass residual without rotor inertia has only one mass")
        self.variants = tuple(variants)
        self.gain = gain
        self.values: Matrix = np.zeros((len(variants), n))
        self._coefficients = np.array([coefficients(variant) for variant in variants])
        self._error = np.zeros_like(self.values)

    def step(self, impulses: Matrix, dt: float) -> Matrix:
        """Advance by one interval of dt seconds; returns `values`, overwritten by the next step.

        impulses: rows of IMPULSES, shape (8, n) [Nm s], finite. With dt beyond 2 / gain the pole
        is clamped at zero: the residual is then the mean external torque of the interval.
        """
        TK = self.gain * dt
        np.dot(self._coefficients, impulses, out=self._error)
        if TK < 2.0:
            self.values *= (2.0 - TK) / (2.0 + TK)
            self._error *= 2.0 * self.gain / (2.0 + TK)
            self.values += self._error
        else:
            np.divide(self._error, dt, out=self.values)
        return self.values

    def reset(self) -> None:
        """Forget the external torque: r = 0."""
        self.values[:] = 0.0

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: dict[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
