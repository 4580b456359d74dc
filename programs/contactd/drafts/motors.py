"""Draft of a profile of motors without an EDS: the maker's figures, and gains for the loads.

The motor's loop is J q'' = k (p - q) + d (p' - q'), J of link and rotor: its bandwidth is
sqrt(k / J), its damping ratio d / (2 sqrt(k J)). While the motor alone holds, gravity torque g
deflects the joint by g / k. The frame format limits d: a heavy joint gets a smaller k, down to a
deflection of 0.07 rad, and beyond that a lower damping ratio.
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
RATIO: Final = 0.71  # wanted damping ratio
SLOWEST: Final = 15.0  # least bandwidth, about four times the gain of the position loop [1/s]
SAG, MOST_SAG = 0.05, 0.07  # deflection by gravity: wanted, and if d is limited [rad]
FRICTION: Final = (0.04, 0.012)  # guessed Coulomb [1] and viscous [s/rad], over rated torque


@dataclass(frozen=True, slots=True)
class DraftedMotor:
    """Draft of the profile of one model."""

    make: str
    model: str
    sends_motor_position: bool = True

    @property
    def link_encoder(self) -> bool:
        """True unless the motor encoder substitutes for a link encoder."""
        return self.make == "damiao"

    @property
    def figures(self) -> ModelFigures:
        """Published figures of the model."""
        return MODELS[self.make, self.model]

    def motor(self, load: Load) -> Motor:
        """Motor of a joint; only its torque depends on the load."""
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
        """Words on whether the motor can carry its joints."""
        rated, most = self.figures.rated_Nm, max(load.gravity for load in loads)
        if most <= rated:
            return "can be used"
        return (
            f"is too weak: gravity requires up to {figure(most)} Nm, it is rated for {rated:g} Nm; "
            "give each joint's model by --drive, in the joints' order"
        )


def model_of(given: str) -> DraftedMotor:
    """Draft of a motor given as MAKE:MODEL, such as `damiao:DM4340`. Raises ConfigurationError."""
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
