"""Population of arms as wide as the world: what nobody identified, or what has changed since.

Every quantity of MISMATCH is off by its whole percentage and only the sign is drawn, so each arm is
a corner of what is allowed, not its middle. Friction drifts by 20 % in ten minutes, too; it is
smooth, Dahl's, or LuGre's with a rise near rest of up to 30 %; its pre-sliding is anything from 0.1
to 2 mrad, the gear's stiffness from 300 to 4000 Nm/rad; some drives take setpoints as steps.
"""

from typing import Final, Literal

import numpy as np

from bench.rigs.arm_without_bus import Subject
from bench.study import population
from daemon.config.load import Robot
from simulator.description import Mismatch, SimulationSettings

Law = Literal["smooth", "dahl", "lugre"]
LAWS: Final[tuple[Law, ...]] = ("smooth", "dahl", "lugre")

MISMATCH: Final = Mismatch(
    mass=5, center_of_mass=0, friction=40, torque_constant=3, half_gap=10, rotor_inertia=10
)
DRIFT: Final = 0.2
DRIFT_PERIOD_S: Final = 2400.0
"""of the whole swing, so that DRIFT takes ten minutes"""
PRESLIDING: Final = (1e-4, 2e-3)
"""[rad]"""
STRIBECK: Final = (1.0, 1.3)
STIFFNESS: Final = (300.0, 4000.0)
"""[Nm/rad]"""
STEPPING: Final = 0.3
"""share of the arms whose drives do not interpolate"""


def subject(robot: Robot, law: Law, seed: int) -> Subject:
    """One arm; that of the same seed and another law has all else in common."""
    rng = np.random.default_rng((seed, 30))

    def between(limits: tuple[float, float]) -> float:
        return float(np.exp(rng.uniform(*np.log(limits))))

    presliding, stiffness, stribeck = between(PRESLIDING), between(STIFFNESS), between(STRIBECK)
    settings = SimulationSettings(
        seed=seed,
        mismatch=MISMATCH,
        friction="smooth" if law == "smooth" else "dahl",
        presliding=presliding,
        stribeck=stribeck if law == "lugre" else 1.0,
        contact_stiffness=stiffness,
        link_latency_ms=float(rng.uniform(0.0, population.LATENCY_MS)),
        **population.velocity_errors(rng),
    )
    return Subject(
        robot=robot,
        settings=settings,
        displacement_m=population.DISPLACEMENT_M,
        drift=DRIFT,
        drift_period_s=DRIFT_PERIOD_S,
        interpolates=bool(rng.random() > STEPPING),
    )
