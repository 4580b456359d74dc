"""Friction identified for one joint, its uncertainty, and the transmission that adopts it."""

from dataclasses import dataclass, field, replace

import numpy as np

from estimator.transmission import Transmission, load_range, stiction_range
from identification.friction_verdict import Verdict
from identification.regression import NORMAL_95
from identification.sticking import SURE

WIDE = 0.15
"""Relative width of a friction's interval from which on a better identification is worth it."""
_MATTERS = 0.1
_NARROWER = 0.8  # factor on the interval for which masses are worth identifying
_SURE = 6.0
"""Standard errors from zero at which friction seen in the gap is trusted: they are of noise only,
and it was up to four of them off the truth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionFit:
    """Coefficients fitted to one joint's motion; SI at the link side."""

    joint: str
    verdict: Verdict
    reason: str
    """Explanation with the figures; empty when good."""
    values: dict[str, float]
    """Coefficients by names of `COLUMNS`; those that were not fitted are missing."""
    errors: dict[str, float]
    """Standard errors: `noise`, and those by masses and torque constants that may be wrong."""
    noise: dict[str, float]
    """Part of them that a longer motion reduces, from the scatter between blocks of 1 s"""
    of_masses: dict[str, float] = field(default_factory=dict)
    """Part of them that identified masses remove"""
    seconds: float
    """of the motion"""
    r2: float
    """R2 on held-out motion, of the friction alone (14)."""
    condition: float
    """Condition number of the scaled columns that count while engaged."""
    gravity_scale: float
    """Gravity that the motor carries, by K_c, over the model's: 1 if they agree; NaN if gravity
    hardly changes."""
    gravity_change: float
    """Range of the model's gravity over the motion [Nm]."""
    offset: float
    """Constant torque [Nm] in the current that nothing explains."""
    rotor_doubt: str
    """Reason why B is not that of the rotor, and what to do; empty if it is."""
    stiction: float
    """Share of K_theta_s that near rest is what the last motion left; NaN if it did not show"""
    stiction_error: float
    """Its standard error"""
    load_bound: float
    """Upper bound of Coulomb friction per transmitted torque, seen or not (95 %)."""

    @property
    def rotor_trusted(self) -> bool:
        """True if B may be used."""
        return not self.rotor_doubt

    @property
    def stiction_known(self) -> bool:
        """True if `stiction` showed clearly."""
        return self.stiction_error < SURE

    @property
    def load(self) -> tuple[float, float] | None:
        """95 % interval of the Coulomb friction per transmitted torque; None if it did not show."""
        if "K_load" not in self.values:
            return None
        share, off = self.values["K_load"], NORMAL_95 * self.errors["K_load"]
        return max(share - off, 0.0), min(share + off, 0.5)

    def half_interval(self, name: str) -> float:
        """Half of the 95 % interval of a coefficient."""
        return NORMAL_95 * self.errors[name]

    @property
    def gravity_off(self) -> float:
        """Torque [Nm] by which the model's gravity is off; 0 if that is a small part of the
        friction, or not known."""
        off = abs(self.gravity_scale - 1.0) * self.gravity_change
        return off if off > _MATTERS * self.values["K_theta_s"] else 0.0

    @property
    def uncertainty(self) -> float:
        """Relative width of the 95 % interval of friction, the wider of Coulomb and viscous."""
        return self.uncertainty_after(self.seconds)

    @property
    def masses_matter(self) -> bool:
        """True if that is clearly narrower with identified masses."""
        return self.uncertainty_after(self.seconds, weighed=True) < _NARROWER * self.uncertainty

    def uncertainty_after(self, seconds: float, *, weighed: bool = False) -> float:
        """The same for a motion like this one of another length: noise falls with the root of the
        length; the part of masses (unless `weighed`) and torque constant remains."""
        shorter, of = self.seconds / seconds, self.of_masses if weighed else {}
        widths = [
            np.sqrt(self.errors[name] ** 2 - (1.0 - shorter) * self.noise[name] ** 2
                    - of.get(name, 0.0) ** 2) / size
            for name, size in self._sizes()
        ]  # fmt: skip
        return float(2.0 * NORMAL_95 * max(widths))

    def seconds_for(self, width: float) -> float:
        """Length [s] of a motion like this one after which `uncertainty` is `width`; infinite if
        the part of masses and torque constant is wider."""
        needed = []
        for name, size in self._sizes():
            noise = self.noise[name] ** 2
            left = (0.5 * width / NORMAL_95 * size) ** 2 - (self.errors[name] ** 2 - noise)
            needed.append(self.seconds * noise / left if left > 0.0 else float("inf"))
        return max(needed)

    def _sizes(self) -> list[tuple[str, float]]:
        """Coulomb and viscous friction to which their errors are related, at least a tenth of
        Coulomb's: smaller viscous friction, at 1 rad/s, does not matter."""
        least = max(_MATTERS * self.values["K_theta_s"], 1e-9)
        return [(name, max(self.values[name], least)) for name in ("K_theta_s", "K_theta_v")]

    def link_friction(self, name: str) -> float | None:
        """K_q_s or K_q_v if the gap showed it clearly, else None."""
        value = self.values.get(name)
        return value if value is not None and value > _SURE * self.errors[name] else None


_ADOPTED = (
    *("motor_coulomb", "motor_viscous", "link_coulomb", "link_viscous"),
    *("gap_coulomb", "gap_viscous", "least_stiction", "most_stiction"),
    *("load_friction", "load_friction_error"),
    *("rotor_inertia", "contact_stiffness", "contact_damping"),
)


def adopt(t: Transmission, fits: list[FrictionFit]) -> Transmission:
    """Transmission with the identified values; joints whose fit is not good keep their old ones.

    The sum K_theta is divided: the link gets K_q if the gap showed it clearly, else its old share;
    the rotor gets the rest, K_theta - K_q, so that `motor_*` is the rotor's own.
    """
    new = {name: getattr(t, name).copy() for name in _ADOPTED}
    for i, fit in enumerate(fits):
        if fit.verdict is not Verdict.GOOD:
            continue
        v = fit.values
        for kind, letter in (("coulomb", "s"), ("viscous", "v")):
            total = v[f"K_theta_{letter}"]
            link, rotor = new[f"link_{kind}"][i], new[f"motor_{kind}"][i]
            share = link / (link + rotor) if link + rotor > 0.0 else 0.0
            alone = fit.link_friction(f"K_q_{letter}")
            link = min(share * total if alone is None else alone, total)
            new[f"link_{kind}"][i], new[f"motor_{kind}"][i] = link, total - link
            new[f"gap_{kind}"][i] = v.get(f"K_phi_{letter}", 0.0)
        if fit.stiction_known:
            least, most = stiction_range(fit.stiction)
            new["least_stiction"][i], new["most_stiction"][i] = least, most
        # Without load friction, its mean is in Coulomb friction.
        new["load_friction"][i], new["load_friction_error"][i] = load_range(fit.load)
        if fit.rotor_trusted:
            new["rotor_inertia"][i] = v["B"]
        new["contact_stiffness"][i] = v.get("K_phi_p", 0.0)
        new["contact_damping"][i] = v.get("K_phi_d", 0.0)
    return replace(t, **new)
