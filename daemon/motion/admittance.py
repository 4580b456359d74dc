"""Admittance, eq. (15): the arm moves the way it is pushed, within bounds.

    q_dot_d = K_a r_bar,    tau q_ddot_d + q_dot_d = K_a r_bar   with a virtual mass

r_bar is the thresholded residual, from which the threshold is subtracted: at the threshold the
velocity starts from zero. As a mass M and a damper D pushed by r_bar: D = 1 / K_a, M = tau / K_a.

For a leading hand an `Assist` is added: a lasting push moves the arm more easily than an
oscillating one, so that K_a can stay below the limit of stability with a stiff hand.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from common.arrays import Vector

# Rates at which an assist grows with a hand, shrinks without, and leaks [1/s].
GROWS: Final = 5.0
SINKS: Final = 20.0
LEAKS: Final = 2.0
# Duration of the linear ramp to a changed gain, without a jerk in the person's hand [s].
GAIN_RAMP_S = 0.5


@dataclass(frozen=True, slots=True)
class AdmittanceLaw:
    """Admittance law, eq. (15), with virtual mass and largest speed of each joint, (n,)."""

    virtual_mass_s: Vector  # tau, time constant of the velocity [s]; 0 follows at once
    velocity: Vector  # [rad/s]

    def velocity_after(
        self,
        before: Vector,
        gain: Vector,
        thresholded: Vector,
        dt: float,
        assist: Vector | float = 0.0,
    ) -> Vector:
        """Desired velocity [rad/s] one interval dt [s] after `before`, pushed by the thresholded
        residual [Nm]; `gain` is K_a, `assist` [rad/s] is added. Backward Euler: stable for every
        dt."""
        pushed = gain * thresholded + assist
        target = np.minimum(np.maximum(pushed, -self.velocity), self.velocity)
        velocity: Vector = before + self.share(dt) * (target - before)
        return velocity

    def share(self, dt: float) -> Vector:
        """Share (n,) of the difference to its target that the velocity covers in dt [s]."""
        return dt / (self.virtual_mass_s + dt)


class Gains:
    """Gains K_a per joint (n,) [rad/s per Nm], changed as ramps."""

    def __init__(self, gain: Vector) -> None:
        self.value = gain.copy()
        self.goal = gain.copy()
        self._rate = np.zeros_like(gain)

    def change(self, joint: int, gain: float) -> None:
        """Ramp the gain of one joint to `gain` from now on."""
        self.goal[joint] = gain
        self._rate[joint] = abs(gain - self.value[joint]) / GAIN_RAMP_S

    def step(self, dt: float) -> None:
        """Advance the ramps by dt [s]."""
        if any(self._rate.tolist()):
            left = self.goal - self.value
            reach = self._rate * dt
            arrived = np.abs(left) <= reach
            self.value = np.where(arrived, self.goal, self.value + np.sign(left) * reach)
            self._rate[arrived] = 0.0


class Assist:
    """Velocity a (n,) [rad/s] added in the direction of a hand that is witnessed to lead.

        a_dot = K_a GROWS e - LEAKS a        e [Nm]: excess over what witnesses a hand

    For e < 0, SINKS replaces GROWS; a is zero without a push or gain, and when the push reverses:
    what moves an arm without a hand cannot sustain it. A lasting push meets
    1 / (1 + GROWS / LEAKS) of the damping, one that changes faster all of it.
    """

    def __init__(self, most: Vector) -> None:
        """most: largest (n,) [rad/s]."""
        self.velocity: Vector = np.zeros_like(most)
        self._most = most

    def stop(self) -> None:
        """End the assist at once."""
        self.velocity = np.zeros_like(self._most)

    def step(self, gain: Vector, push: Vector, excess: Vector, dt: float) -> None:
        """Process thresholded residual and signed excess [Nm] of dt [s]; `gain` is K_a."""
        direction = np.sign(push)
        beyond, size = excess * direction, np.maximum(self.velocity * direction, 0.0)
        grown = size + dt * (np.where(beyond > 0.0, GROWS, SINKS) * gain * beyond - LEAKS * size)
        self.velocity = direction * np.minimum(np.maximum(grown, 0.0), self._most * (gain > 0.0))


@dataclass(frozen=True, slots=True)
class AllowanceSettings:
    """Bounds on the duration [s] and distance [rad] over which contacts may lead the arm."""

    max_duration_s: float
    max_excursion: float


class Allowance:
    """Use of the bounds on led motion since the arm was armed.

    Time counts up while the arm yields and down while it does not, so that short breaks of contact
    do not restart it. Distance is the sum of the displacements by all contacts since the arm was
    armed: a biased residual cannot move it away in small steps.
    """

    def __init__(self, bounds: AllowanceSettings, n: int) -> None:
        self._bounds = bounds
        self._spent_s = 0.0
        self._moved = np.zeros(n)
        self.home: Vector | None = None
        """Reference at which a contact took the arm (n,) [rad]; None without a contact."""

    def renew(self) -> None:
        """Reset time and distance, when the arm is armed."""
        self._spent_s = 0.0
        self._moved[:] = 0.0

    def take(self, reference: Vector) -> None:
        """Begin a contact, from the reference (n,) [rad]; no effect during another one."""
        if self.home is None:
            self.home = reference.copy()

    def leave(self, reference: Vector) -> None:
        """End a contact: the arm continues by itself from the reference (n,) [rad]."""
        if self.home is not None:
            self._moved += reference - self.home
            self.home = None

    def spend(self, dt: float) -> None:
        """Count dt [s] in which the arm yielded."""
        self._spent_s += dt

    def recover(self, dt: float) -> None:
        """Count dt [s] in which the arm did not yield."""
        self._spent_s = max(self._spent_s - dt, 0.0)

    def bound_reached(self, q: Vector) -> str:
        """Description of the bound that the arm has passed at q (n,) [rad]; empty while none."""
        bounds = self._bounds
        # Half a millisecond is for the rounding of sums of periods.
        if self._spent_s > bounds.max_duration_s + 5e-4:
            return f"led for more than {bounds.max_duration_s:g} s (admittance.max_duration_s)"
        if self.home is None:
            return ""
        most = bounds.max_excursion
        if float(np.abs(self._moved + q - self.home).max()) > most:
            return f"led further than {most:g} rad since `arm` (admittance.max_excursion)"
        return ""
