"""Settings of the friction law in the simulated joints, of motor and link alike; the law is in
`two_masses.py`."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["smooth", "dahl"]


@dataclass(frozen=True, slots=True)
class FrictionLaw:
    """Coulomb's torque over a velocity's tanh, `smooth`; or Dahl's with stiction, `dahl`. Either
    with Stribeck's rise near rest; Dahl's with that is LuGre's."""

    kind: Kind = "smooth"
    width: float = 0.02
    """smooth: Coulomb * tanh(velocity / width) [rad/s]"""
    presliding: float = 0.0003
    """dahl: deflection at which friction is fully built up [rad]"""
    stribeck: float = 1.0
    """friction just off rest, over Coulomb's; 1: no rise"""
    stribeck_velocity: float = 0.05
    """at which the rise has fallen to exp(-1) of itself [rad/s]"""
