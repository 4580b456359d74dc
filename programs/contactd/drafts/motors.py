"""Draft of a profile of motors without an EDS: their maker's figures, and gains for their loads.

In the motor, J q'' = k (p - q) + d (p' - q'), with J of link and rotor: a bandwidth of sqrt(k / J)
and a damping ratio of d / (2 sqrt(k J)). Gravity g pulls the joint by g / k while the motors alone
hold. Frames end at some d: a heavy joint gets a softer k, down to a pull of 0.07 rad, and beyond
that less damping.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

from common.errors import ConfigurationError
from common.yaml_source import quoted
from daemon.config.problem import figure
from drivers.damiao import settings as damiao
from drivers.motors.settings import ModelFigures
from drivers.robstride import settings as robstride
from programs.contactd.drafts.motor import Load, Motor
from programs.identify.guesses import MARK

MODELS: Final[dict[tuple[str, str], ModelFigures]] = {
    **{("damiao", model): figures for model, figures in damiao.MODELS.items()},
    **{("robstride", model): figures for model, figures in robstride.MODELS.items()},
}
"""Figures by make and model."""
RATIO: Final = 0.71  # of damping
SLOWEST: Final = 15.0  # bandwidth, some four times the position loop's gain [1/s]
SAG, MOST_SAG = 0.05, 0.07  # by gravity: wanted, and where damping does not allow it [rad]
FRICTION: Final = (0.04, 0.012)  # guesses: of the rated torque; the second s/rad


@dataclass(frozen=True, slots=True)
class DraftedMotor:
    """Draft of the profile of one model."""

    make: str
    model: str
    sends_motor_position: bool = True

    @property
    def link_encoder(self) -> bool:
        """True unless the motor's encoder stands for one."""
        return self.make == "damiao"

    @property
    def figures(self) -> ModelFigures:
        """Its published figures."""
        return MODELS[self.make, self.model]

    def motor(self, load: Load) -> Motor:
        """Motor of a joint, which is the same for each load."""
        f = self.figures
        coulomb, viscous = (share * f.rated_Nm for share in FRICTION)
        return Motor(
            gear=f.gear, rated_A=f.rated_Nm / f.torque_constant, max_A=f.max_current_A,
            constant=f.torque_constant, rotor=f.rotor * f.gear**2,
            torque=min(load.torque, f.max_current_A * f.torque_constant),
            friction=(coulomb, viscous), end="hold", sure=True,
        )  # fmt: skip

    def text(self, name: str, loads: Sequence[Load]) -> str:
        """Entry of `config.yaml` under `drives`, with gains for the heaviest joint."""
        f = self.figures
        stiffness, damping = gains(loads, f)
        ratio = damping / (2.0 * sqrt(stiffness * _inertia(loads, f)))
        reach, at = "", "of its firmware's manual, as motors do not say it"
        if self.make == "damiao":
            at = "of registers 21 to 23, which `contactd scan` prints"
            reach = f"    position_max: {damiao.REACH:g}   {MARK}: {at}\n"
        return f"""\
  {quoted(name)}:
    make: {self.make}
    model: {self.model}   {MARK}: on the motor's label
{reach}    velocity_max: {f.velocity_max:g}   {MARK}: {at}
    torque_max_Nm: {f.torque_max_Nm:g}   {MARK}: {at}
    stiffness: {figure(stiffness)}   {MARK}: for the URDF's masses; less where a joint swings
    damping: {figure(damping)}   {MARK}: ratio {ratio:.2f} at worst
"""

    def verdict(self, loads: Sequence[Load]) -> str:
        """Sentence on whether the motor carries its joints."""
        rated, most = self.figures.rated_Nm, max(load.gravity for load in loads)
        if most <= rated:
            return "can be used"
        return (
            f"is too weak: gravity asks for up to {figure(most)} Nm of its rated {rated:g} Nm; "
            "give each joint's model by --drive, in the joints' order"
        )


def model_of(given: str) -> DraftedMotor:
    """Draft of `damiao:DM4340`. Raises ConfigurationError."""
    make, _, model = given.partition(":")
    found = make.lower(), model.upper()
    if found not in MODELS:
        own = [its for its in MODELS if its[0] == found[0]]
        why = f"no make {make}" if make and model else "must be [NAME=]MAKE:MODEL"
        why = f"{own[0][0]} has no model {model}" if own and model else why
        known = ", ".join(map(":".join, own or MODELS))
        raise ConfigurationError(f"--drive {given}: {why}; there are {known}")
    return DraftedMotor(*found)


def gains(loads: Sequence[Load], figures: ModelFigures) -> tuple[float, float]:
    """Stiffness [Nm/rad] and damping [Nm s/rad] of a motor, for the heaviest of its joints."""
    inertia, most = _inertia(loads, figures), figures.most_damping
    gravity = max(load.gravity for load in loads)
    damped = (most / (2.0 * RATIO)) ** 2 / inertia
    wanted = min(max(SLOWEST**2 * inertia, gravity / SAG), damped)
    stiffness = min(max(wanted, gravity / MOST_SAG), figures.stiffest)
    return stiffness, min(2.0 * RATIO * sqrt(stiffness * inertia), most)


def _inertia(loads: Sequence[Load], figures: ModelFigures) -> float:
    return figures.rotor * figures.gear**2 + max(load.inertia for load in loads)
