"""Momentum residuals: first-order estimates of the external torque, (2), (12) and (13).

All variants share one form. Over an interval T the momentum of the links changes by the impulses
that act on them, and what is left over is the impulse of the external torque:

    e(k) = Delta(M q_dot) - T beta - T tau_L + T tau_mu
    r(k) = [(2 - T K) r(k-1) + 2 K e(k)] / (2 + T K)

which is (13) by increments: no integral grows, and it starts from r = 0 whatever the momentum. The
rotor's B theta_ddot enters as the increment B Delta theta_dot, so that nothing is differentiated
twice; `interval` makes increments and integrals.

An interval counts as gap only if the joint is in the gap at both ends. When the rotor meets the
link within an interval, tau_M, friction and B Delta theta_dot of the whole interval must be taken
together: what the rotor won in the gap is what it gives to the link.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from arrays import Matrix, Vector
from errors import ModelError
from estimator import memory
from estimator.interval import ROW, Form

Kind = Literal["classical", "backlash", "two_mass"]


_SHORTEST_S = 1e-9
"""A joint without a new sample has an interval of 0."""


class Variant(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One residual; parts of the joint's dynamics can be left out, to show what they are worth."""

    kind: Kind = "backlash"
    friction: bool = True
    rotor_inertia: bool = True
    label: Annotated[str, Meta(min_length=1, max_length=64)] = ""

    @property
    def name(self) -> str:
        """The label, or the kind and what differs from it: `classical`, `backlash-rotor`."""
        if self.label:
            return self.label
        if self.kind == "classical":
            return "classical" + "+friction" * self.friction + "+rotor" * self.rotor_inertia
        return self.kind + "-friction" * (not self.friction) + "-rotor" * (not self.rotor_inertia)


class _Sides(NamedTuple):
    """A form in two parts: what always acts, and what acts only while rotor and link touch."""

    always: Form
    engaged: Form


# Terms of e beside momentum and beta: drive, friction and rotor inertia, by kind.
_TERMS_OF: dict[Kind, tuple[_Sides, _Sides, _Sides]] = {
    "classical": (
        _Sides({"tau_M": -1.0}, {}),
        _Sides({"motor_friction": 1.0, "engaged_link_friction": 1.0, "stiction": 1.0}, {}),
        _Sides({"rotor": 1.0}, {}),
    ),
    "backlash": (
        _Sides({}, {"tau_M": -1.0}),
        _Sides(  # (6): K_theta while engaged; K_phi and K_q inside the gap
            {"link_friction": 1.0, "gap_friction": 1.0},
            {
                **{"motor_friction": 1.0, "engaged_link_friction": 1.0, "stiction": 1.0},
                **{"link_friction": -1.0, "gap_friction": -1.0},
            },
        ),
        _Sides({}, {"rotor": 1.0}),
    ),
    "two_mass": (
        _Sides({"tau_M": -1.0}, {}),
        _Sides({"motor_friction": 1.0, "link_friction": 1.0, "stiction": 1.0}, {}),
        _Sides({"rotor": 1.0}, {}),
    ),
}


def forms(variant: Variant) -> tuple[Form, Form]:
    """e(k) of a variant: the sum of terms that always counts, and that while engaged."""
    drive, friction, rotor = _TERMS_OF[variant.kind]
    parts = [drive, *[friction] * variant.friction, *[rotor] * variant.rotor_inertia]
    always: dict[str, float] = {"momentum": 1.0, "beta": -1.0}
    engaged: dict[str, float] = {}
    for sides in parts:
        always.update(sides.always)
        engaged.update(sides.engaged)
    return always, engaged


def weights(
    variants: Sequence[Variant], gain: float, period: float
) -> tuple[Matrix, Matrix, Vector]:
    """Weights of `interval.TERMS` in each variant's e(k), always and while engaged, each (variants,
    TERMS); and 1 for variants (variants,) whose tau_M a fit corrects: those with engagement.

    Raises ModelError for gain * period >= 2, where the pole of (13) would be negative and the
    residual would ring, and for variants that are alike or contradict themselves.
    """
    if not 0.0 < gain * period < 2.0:
        raise ModelError(f"residual gain {gain} /s at {period} s: gain * period must be < 2")
    names = [variant.name for variant in variants]
    if len(set(names)) != len(names):
        raise ModelError(f"residuals must have different names: {', '.join(names)}")
    tables = np.zeros((2, len(variants), len(ROW)))
    for row, variant in enumerate(variants):
        if variant.kind == "two_mass" and not variant.rotor_inertia:
            raise ModelError("a two_mass residual without rotor inertia has only one mass")
        for table, form in zip(tables, forms(variant), strict=True):
            for name, weight in form.items():
                table[row, ROW[name]] = weight
    corrected = np.array([float(variant.kind == "backlash") for variant in variants])
    return tables[0], tables[1], corrected


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
        # Rows of `forms`: the parts that always act, then those that act while engaged.
        self.always, self.engaged = slice(len(variants)), slice(len(variants), None)
        self._error = np.zeros_like(self.values)

    def forms(self) -> list[Form]:
        """The sums that an `Interval` makes for `step`: every variant's part that always acts, then
        every variant's part that acts while engaged."""
        always, engaged = zip(*map(forms, self.variants), strict=True)
        return [*always, *engaged]

    def step(self, impulses: Matrix, engaged: Vector, dt: Vector) -> Matrix:
        """Advance by one interval of dt (n,) [s]; returns `values`, overwritten by the next step.

        impulses: those of `forms`, shape (2 * variants, n) [Nm s], finite, and zero where dt is;
        engaged: (n,), 1 where rotor and link touched, 0 where they were apart. With dt beyond
        2 / gain the pole is clamped at zero: the residual is then the mean external torque of the
        interval.
        """
        error, TK = self._error, self.gain * dt
        np.multiply(impulses[self.engaged], engaged, out=error)
        np.add(error, impulses[self.always], out=error)
        # At TK = 2, K e T / T = e / T, and beyond it the pole stays there.
        pole = np.maximum((2.0 - TK) / (2.0 + TK), 0.0)
        error *= np.minimum(2.0 * self.gain / (2.0 + TK), 1.0 / np.maximum(dt, _SHORTEST_S))
        self.values *= pole
        self.values += error
        return self.values

    def reset(self, joints: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Forget the external torque on these joints, or on all: r = 0."""
        self.values[:, joints] = 0.0

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: dict[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
