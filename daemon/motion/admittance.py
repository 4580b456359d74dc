"""Admittance, eq. (15): the arm moves the way it is pushed, within bounds.

    q_dot_d = K_a r_bar,    tau q_ddot_d + q_dot_d = K_a r_bar   with a virtual mass

r_bar is the thresholded residual, from which the threshold is subtracted: at the threshold the
velocity starts from zero. As a mass M and a damper D pushed by r_bar: D = 1 / K_a, M = tau / K_a.
"""

from dataclasses import dataclass

import numpy as np

from arrays import Vector

# The softest admittance that may be asked for [rad/s per Nm].
MAX_GAIN = 5.0
# A changed gain is reached evenly over this time, so that the hand feels no bump [s].
GAIN_RAMP_S = 0.5


@dataclass(frozen=True, slots=True)
class AdmittanceLaw:
    """Virtual mass and largest speed of each joint, shape (n,)."""

    virtual_mass_s: Vector  # tau, time constant of the velocity [s]; 0 follows at once
    velocity: Vector  # [rad/s]

    def velocity_after(
        self, before: Vector, gain: Vector, thresholded: Vector, dt: float
    ) -> Vector:
        """Desired velocity [rad/s] one interval dt [s] after `before`, pushed by the thresholded
        residual [Nm]; `gain` is K_a. Backward Euler: stable for every dt."""
        target = np.minimum(np.maximum(gain * thresholded, -self.velocity), self.velocity)
        velocity: Vector = before + dt / (self.virtual_mass_s + dt) * (target - before)
        return velocity


class Gains:
    """K_a per joint [rad/s per Nm], and how it gets from one value to the next."""

    def __init__(self, gain: Vector) -> None:
        self.value = gain.copy()
        self.goal = gain.copy()
        self._rate = np.zeros_like(gain)

    def change(self, joint: int, gain: float) -> None:
        """Let the gain of one joint move to `gain` from now on."""
        self.goal[joint] = gain
        self._rate[joint] = abs(gain - self.value[joint]) / GAIN_RAMP_S

    def step(self, dt: float) -> None:
        """Move on by dt [s]."""
        if np.count_nonzero(self._rate):
            left = self.goal - self.value
            reach = self._rate * dt
            arrived = np.abs(left) <= reach
            self.value = np.where(arrived, self.goal, self.value + np.sign(left) * reach)
            self._rate[arrived] = 0.0


@dataclass(frozen=True, slots=True)
class AllowanceSettings:
    """How long [s] and how far [rad] contacts may lead the arm."""

    max_duration_s: float
    max_excursion: float


class Allowance:
    """What is left of the bounds of one arming.

    Time counts up while the arm yields and down while it does not, so that a residual that lets go
    now and then is no way around it. Distance is how far all contacts since the arming have moved
    what the arm does by itself, in sum: a biased residual cannot walk the arm away in small steps.
    """

    def __init__(self, bounds: AllowanceSettings, n: int) -> None:
        self._bounds = bounds
        self._spent_s = 0.0
        self._moved = np.zeros(n)
        self.home: Vector | None = None
        """Where the arm was to be when a contact took it [rad]; None while none has."""

    def renew(self) -> None:
        """The arm was armed anew."""
        self._spent_s = 0.0
        self._moved[:] = 0.0

    def take(self, reference: Vector) -> None:
        """A contact takes the arm from its reference (n,) [rad]; during another, nothing new."""
        if self.home is None:
            self.home = reference.copy()

    def leave(self, reference: Vector) -> None:
        """The arm goes on by itself from a reference (n,) [rad]."""
        if self.home is not None:
            self._moved += reference - self.home
            self.home = None

    def spend(self, dt: float) -> None:
        """The arm yielded for dt [s]."""
        self._spent_s += dt

    def recover(self, dt: float) -> None:
        """The arm did not yield for dt [s]."""
        self._spent_s = max(self._spent_s - dt, 0.0)

    def bound_reached(self, q: Vector) -> str:
        """Which bound the arm has passed at q (n,) [rad], in words; empty while none."""
        bounds = self._bounds
        # Times are sums of periods; half a millisecond keeps their rounding out of it.
        if self._spent_s > bounds.max_duration_s + 5e-4:
            return f"guided for more than {bounds.max_duration_s:g} s"
        if self.home is None:
            return ""
        if float(np.abs(self._moved + q - self.home).max()) > bounds.max_excursion:
            return f"guided further than {bounds.max_excursion:g} rad since it was armed"
        return ""
