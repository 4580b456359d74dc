"""Draft of a profile of Damiao motors: their maker's figures, and gains for what they carry.

In the motor, J q'' = k (p - q) + d (p' - q'), with J of link and rotor: a bandwidth of sqrt(k / J)
and a damping ratio of d / (2 sqrt(k J)). Gravity g pulls the joint by g / k while the motors alone
hold. The frames end at d = 5 Nm s/rad: a heavy joint gets a softer k, down to a pull of 0.07 rad,
and beyond that less damping.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final, get_args

from common.errors import ConfigurationError
from common.yaml_source import quoted
from daemon.config.problem import figure
from drivers.damiao.frames import MOST_DAMPING, STIFFEST
from drivers.damiao.settings import MODELS, REACH, Model
from programs.contactd.drafts.motor import MARK, Load, Motor

MAKE: Final = "damiao"
RATIO: Final = 0.71  # of damping
SLOWEST: Final = 15.0  # bandwidth, some four times the position loop's gain [1/s]
SAG, MOST_SAG = 0.05, 0.07  # by gravity: wanted, and where damping does not allow it [rad]
FRICTION: Final = (0.04, 0.012)  # guesses: of the rated torque; the second s/rad


@dataclass(frozen=True, slots=True)
class DraftedMotor:
    """Draft of the profile of one model."""

    model: Model
    link_encoder: bool = True
    sends_motor_position: bool = True

    def motor(self, load: Load) -> Motor:
        """Motor of a joint, which is the same for each load."""
        f = MODELS[self.model]
        coulomb, viscous = (share * f.rated_Nm for share in FRICTION)
        return Motor(
            gear=f.gear, rated_A=f.rated_Nm / f.torque_constant, max_A=f.max_current_A,
            constant=f.torque_constant, rotor=f.rotor * f.gear**2,
            torque=min(load.torque, f.max_current_A * f.torque_constant),
            friction=(coulomb, viscous), end="hold", sure=True,
        )  # fmt: skip

    def text(self, name: str, loads: Sequence[Load]) -> str:
        """Entry of `config.yaml` under `drives`, with gains for the heaviest joint."""
        f = MODELS[self.model]
        rotor = f.rotor * f.gear**2
        stiffness, damping = gains(loads, rotor)
        ratio = damping / (2.0 * sqrt(stiffness * _inertia(loads, rotor)))
        return f"""\
  {quoted(name)}:
    make: {MAKE}
    model: {self.model}   {MARK}: on the motor's label
    position_max: {REACH:g}   {MARK}: of registers 21 to 23, which `contactd scan` prints
    velocity_max: {f.velocity_max:g}   {MARK}
    torque_max_Nm: {f.torque_max_Nm:g}   {MARK}
    stiffness: {figure(stiffness)}   {MARK}: for the URDF's masses; less where a joint swings
    damping: {figure(damping)}   {MARK}: ratio {ratio:.2f} at worst
"""

    def verdict(self, loads: Sequence[Load]) -> str:
        """Sentence on whether the motor carries its joints."""
        rated, most = MODELS[self.model].rated_Nm, max(load.gravity for load in loads)
        if most <= rated:
            return "can be used"
        return (
            f"is too weak: gravity asks for up to {figure(most)} Nm of its rated {rated:g} Nm; "
            "give each joint's model by --drive, in the joints' order"
        )


def model_of(given: str) -> DraftedMotor:
    """Draft of `damiao:DM4340`. Raises ConfigurationError."""
    make, _, model = given.partition(":")
    if make.lower() != MAKE or model.upper() not in MODELS:
        raise ConfigurationError(
            f"--drive {given}: must be [NAME=]{MAKE}:MODEL; models are {', '.join(get_args(Model))}"
        )
    return next(DraftedMotor(known) for known in MODELS if known == model.upper())


def gains(loads: Sequence[Load], rotor: float) -> tuple[float, float]:
    """Stiffness [Nm/rad] and damping [Nm s/rad] of a motor whose rotor has this inertia at the link
    [kg m2], for the heaviest of its joints."""
    inertia = _inertia(loads, rotor)
    gravity = max(load.gravity for load in loads)
    damped = (MOST_DAMPING / (2.0 * RATIO)) ** 2 / inertia
    wanted = min(max(SLOWEST**2 * inertia, gravity / SAG), damped)
    stiffness = min(max(wanted, gravity / MOST_SAG), STIFFEST)
    return stiffness, min(2.0 * RATIO * sqrt(stiffness * inertia), MOST_DAMPING)


def _inertia(loads: Sequence[Load], rotor: float) -> float:
    return rotor + max(load.inertia for load in loads)
