"""Population of arms with wide errors: in what was not identified, or has changed since.

Every quantity of MISMATCH is off by its full percentage and only the sign is random, so each arm is
a corner of the allowed range, not its middle. Friction also drifts by 20 % in ten minutes; it is
smooth, Dahl's, or LuGre's with a rise near rest of up to 30 %; its pre-sliding distance is 0.1 to 2
mrad, the gear's stiffness 300 to 4000 Nm/rad; some drives take setpoints as steps.

GEARS are conditions beyond the estimator's model. `load`: friction grows with the torque that the
gear transmits, by up to 15 % of it, or as in gears of 70 to 95 % efficiency, different for driving
and driven. `ripple`: friction ripples by up to 20 % twice a turn of motor and joint, motors cog
with up to 5 % of their rated torque. `rest`: friction rises by up to half within minutes of rest.
`gap`: the gap varies by up to 30 % over a turn.
"""

import dataclasses
from typing import Any, Final, Literal, get_args

import numpy as np
from msgspec.structs import replace

from bench.rigs.arm_without_bus import Subject
from bench.study import population
from daemon.config.load import Robot
from simulator.description import Mismatch, SimulationSettings
from simulator.gear_settings import GearSettings

Law = Literal["smooth", "dahl", "lugre"]
LAWS: Final[tuple[Law, ...]] = ("smooth", "dahl", "lugre")

Gears = Literal["modelled", "load", "ripple", "rest", "gap", "all"]
GEARS: Final[tuple[Gears, ...]] = get_args(Gears)

MISMATCH: Final = Mismatch(
    mass=5, center_of_mass=0, friction=40, torque_constant=3, half_gap=10, rotor_inertia=10
)
DRIFT: Final = 0.2
DRIFT_PERIOD_S: Final = 2400.0  # of a full oscillation, so that DRIFT takes ten minutes
PRESLIDING: Final = (1e-4, 2e-3)  # [rad]
STRIBECK: Final = (1.0, 1.3)
STIFFNESS: Final = (300.0, 4000.0)  # [Nm/rad]
STEPPING: Final = 0.3  # share of the arms whose drives do not interpolate

LOAD: Final = (0.0, 0.15)  # friction per transmitted torque, of half of the arms ...
EFFICIENCY: Final = (0.7, 0.95)  # ... and the efficiency of the other half's gears
FRICTION_RIPPLE: Final = 20.0
COGGING: Final = 5.0
GAP_RIPPLE: Final = 30.0  # [percent], at most
REST_RISE: Final = (1.1, 1.5)
REST_S: Final = (30.0, 180.0)


def gear_settings(gears: Gears, seed: int) -> GearSettings:
    """Gear settings of one arm, for one condition or for all."""
    rng = np.random.default_rng((seed, 40))
    share, eta, eta_driven = rng.uniform(*LOAD), rng.uniform(*EFFICIENCY), rng.uniform(*EFFICIENCY)
    efficient = rng.random() < 0.5
    drawn: dict[Gears, dict[str, Any]] = {
        "load": {
            "load_driving": 1.0 / eta - 1.0 if efficient else share,
            "load_driven": 1.0 - eta_driven if efficient else share,
        },
        "ripple": {
            "friction_ripple": rng.uniform(0.0, FRICTION_RIPPLE),
            "cogging": rng.uniform(0.0, COGGING),
        },
        "rest": {"rest_rise": rng.uniform(*REST_RISE), "rest_s": rng.uniform(*REST_S)},
        "gap": {"gap_ripple": rng.uniform(0.0, GAP_RIPPLE)},
    }
    chosen = [drawn[one] for one in drawn if gears in (one, "all")]
    return GearSettings(**{field: value for one in chosen for field, value in one.items()})


def load_known(robot: Robot, gears: GearSettings, error: float) -> Robot:
    """Robot whose load friction was identified to +- `error`."""
    shares = gears.load_driving, gears.load_driven
    load = max(min(shares) - error, 0.0), min(max(shares) + error, 0.5)
    c = robot.configuration
    joints = [replace(one, friction=replace(one.friction, load=load)) for one in c.joints]
    return dataclasses.replace(robot, configuration=replace(c, joints=joints))


def subject(robot: Robot, law: Law, seed: int, gears: Gears = "modelled") -> Subject:
    """One arm; arms of the same seed with another law or other gears are otherwise equal."""
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
        gears=gear_settings(gears, seed),
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
