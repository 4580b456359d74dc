"""Parameters of the friction law of simulated joints, for motor and link alike; the law itself is
in `two_masses.py`."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["smooth", "dahl"]


@dataclass(frozen=True, slots=True)
class FrictionLaw:
    """Coulomb friction with tanh of the velocity (`smooth`), or Dahl's model with stiction
    (`dahl`), either with a Stribeck rise near rest; Dahl with Stribeck is LuGre."""

    kind: Kind = "smooth"
    width: float = 0.02
    """smooth: Coulomb * tanh(velocity / width) [rad/s]."""
    presliding: float = 0.0003
    """dahl: deflection at which friction is fully built up [rad]."""
    stribeck: float = 1.0
    """Friction near rest, relative to Coulomb friction; 1: no rise."""
    stribeck_velocity: float = 0.05
    """Velocity at which the rise has decayed to 1 / e [rad/s]."""
