"""One joint with a gap of 0.02 rad beside a rigid one, for the motor position alone."""

from dataclasses import dataclass, field

import numpy as np

from estimator.motor_position import MotorPosition, Side
from estimator.settings import GapSettings
from estimator.transmission import Transmission, resting

T = 0.01
ALPHA = 0.02
COULOMB = 1.0
STIFF = GapSettings(compliance=0.0)


@dataclass
class Joint:
    """One joint that moves as commanded and sees the given torques."""

    settings: GapSettings = STIFF
    measured: bool = False
    position: MotorPosition = field(init=False)

    def __post_init__(self) -> None:
        transmission = Transmission(
            joints=("loose", "rigid"),
            torque_constant=np.ones(2),
            rotor_inertia=np.zeros(2),
            half_gap=np.array([ALPHA, 0.0]),
            motor_coulomb=np.full(2, COULOMB),
            motor_viscous=np.zeros(2),
            link_coulomb=np.zeros(2),
            link_viscous=np.zeros(2),
        )
        self.position = MotorPosition(transmission, self.settings, self.measured)

    def step(
        self, *, q: float = 0.0, q_dot: float = 0.0, w: float = 0.0, torque: float = 0.0
    ) -> list[bool]:
        rest = resting(np.array([w]))[0]
        return [
            self.position.step(i, T, q, q_dot, w, rest, torque, w * T, 0.0, torque)
            for i in range(2)
        ]

    @property
    def phi(self) -> float:
        return -float(self.position.theta[0])

    @property
    def side(self) -> Side:
        return Side(int(self.position.side[0]))

    @property
    def sigma(self) -> float:
        return float(self.position.sigma[0])

    def settle(self, torque: float) -> None:
        for _ in range(40):
            self.step(torque=torque)

    def set(self, phi: float) -> None:
        """Let the estimate be there, with the link at zero."""
        self.position.theta[0] = -phi
