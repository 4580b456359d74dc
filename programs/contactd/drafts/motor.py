"""Motor of a joint and the load on it: common ground of the drafts of all makes."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Load:
    """Worst-case load of a joint over all poses: gravity torque [Nm], inertia [kg m2]."""

    gravity: float
    inertia: float

    @property
    def torque(self) -> float:
        """Torque of a motor that carries the load with a margin [Nm]."""
        return 2.0 * self.gravity + 6.0 * self.inertia + 1.0


@dataclass(frozen=True, slots=True)
class Motor:
    """Motor with its gear, at the link side: currents [A], torque constant [Nm/A], rotor inertia
    [kg m2], torque [Nm] and friction [Nm, Nm s/rad]. sure: published figures, not guesses."""

    gear: float
    rated_A: float
    max_A: float
    constant: float
    rotor: float
    torque: float
    friction: tuple[float, float]
    end: str
    sure: bool = False
