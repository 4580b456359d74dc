"""Motor of a joint, and what the joint asks of it: where drafts of all makes meet."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Load:
    """Load of a joint at worst, over all poses: torque of gravity [Nm], inertia [kg m2]."""

    gravity: float
    inertia: float

    @property
    def torque(self) -> float:
        """Torque with which a motor carries it with a margin [Nm]."""
        return 2.0 * self.gravity + 6.0 * self.inertia + 1.0


@dataclass(frozen=True, slots=True)
class Motor:
    """Motor, at the link: currents [A], constant [Nm/A], inertia [kg m2], its torque and friction
    [Nm, Nm s/rad]. sure: its gear and constants are its maker's, not guesses."""

    gear: float
    rated_A: float
    max_A: float
    constant: float
    rotor: float
    torque: float
    friction: tuple[float, float]
    end: str
    sure: bool = False
