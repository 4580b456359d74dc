"""What the arm does in each mode: one decision per tick, from what was measured and estimated.

No I/O and no clock: time is an argument, requests come in between two ticks, and the decision is
plain data. The mathematics of each motion is elsewhere (trajectory, admittance, limits).
"""

from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from daemon.admittance import AdmittanceLaw
from daemon.limits import Limits
from daemon.modes import ARMABLE, REFUSALS, SENSING, Event, Mode, ModeMachine
from daemon.supervisor import EVENT_OF, Condition, Finding, strongest
from daemon.trajectory import Follower
from drivers.cia402 import PowerTarget

Vector = NDArray[np.float64]

# How long a reset may take until a drive's fault counts as a new one [s].
RESET_PATIENCE_S = 0.5
# A joint stands when it moves less than this [rad/s]: a few counts of a coarse velocity.
STANDSTILL_SPEED = 0.02


@dataclass(frozen=True, slots=True)
class Observed:
    """What one tick knows when it decides. Vectors of shape (n,), SI at the link."""

    q: Vector  # measured link position
    motor_velocity: Vector
    thresholded: Vector  # thresholded residual [Nm]
    touched: str  # the contact that lasts, in words; empty without one
    hit: str  # the collision that began in this tick, likewise
    energised: bool  # every drive is in operation enabled
    findings: tuple[Finding, ...]
    not_armable: tuple[str, ...]  # reasons outside the modes why arming would be refused
    age_s: Vector | float = 0.0  # of q, where a sample did not come in time


@dataclass(frozen=True, slots=True)
class Decision:
    """What goes to the drives, and the reference behind it."""

    power: tuple[PowerTarget, ...]
    reset: bool  # ask drives in fault for a reset
    velocity: Vector  # target velocity [rad/s]
    reference: Vector  # desired q [rad]


@dataclass(frozen=True, slots=True)
class Tuning:
    """What the configuration says about motion."""

    joints: tuple[str, ...]
    ends: tuple[str, ...]  # hold, brake or limp, per joint
    position_gain: float
    quiet_s: float
    enable_timeout_s: float
    stop_timeout_s: float


class Controller:
    """Modes, references and setpoints of one arm."""

    def __init__(
        self, tuning: Tuning, limits: Limits, law: AdmittanceLaw, follower: Follower
    ) -> None:
        n = len(tuning.joints)
        self.machine = ModeMachine()
        self.quiet_s = 0.0
        self._tuning, self._limits, self._law, self._follower = tuning, limits, law, follower
        self._velocity = np.zeros(n)
        self._reference = np.zeros(n)
        self._entry = np.zeros(n)  # where admittance began
        self._touched_s = 0.0  # last tick with a non-zero thresholded residual
        self._reset_until_s = -1.0
        self._observed: Observed | None = None

    @property
    def faulted(self) -> bool:
        """Whether a fault is latched."""
        return self.machine.mode is Mode.FAULTED

    # --- what a person asks for, between two ticks ------------------------------------------

    def request(self, event: Event, who: str, time_s: float) -> list[str]:
        """Carry out a command; returns the reasons of a refusal, empty when it was done."""
        reasons = self._refusals(event)
        if not reasons:
            self._apply(event, f"{event.value} by {who}", time_s)
        return reasons

    def arm(self, who: str) -> list[str]:
        """Allow contacts to lead to admittance; returns every reason why not."""
        reasons = self.not_armable()
        if not reasons:
            self.machine.arm(f"armed by {who}")
        return reasons

    def not_armable(self) -> list[str]:
        """Every reason why `arm` would be refused now."""
        observed, mode = self._observed, self.machine.mode
        if observed is None:
            return ["no samples of the drives yet"]
        modes = [] if mode in ARMABLE else [REFUSALS[mode]]
        return [*modes, *observed.not_armable]

    def _refusals(self, event: Event) -> list[str]:
        mode, observed = self.machine.mode, self._observed
        if not self.machine.can(event):
            return [f"cannot {event.value}: {REFUSALS[mode]}"]
        if event in (Event.ENABLE, Event.START, Event.RESET) and observed is None:
            return ["no samples of the drives yet"]
        if event is Event.START and observed is not None:
            self._follower.rewind()
            return self._misfits(observed.q)
        if event is Event.ENABLE and observed is not None:
            outside = self._limits.outside(observed.q)
            return [
                f"{name} stands at {observed.q[i]:.3f} rad, outside its limits "
                f"[{self._limits.lower[i]:g}, {self._limits.upper[i]:g}]: move it back by hand"
                for i, name in enumerate(self._tuning.joints)
                if outside[i]
            ]
        return []

    def _misfits(self, q: Vector) -> list[str]:
        misfits = self._follower.misfits(q, self._limits.lower, self._limits.upper)
        return [
            f"from {q[i]:.3f} rad the path of {name} would leave its limits "
            f"[{self._limits.lower[i]:g}, {self._limits.upper[i]:g}]"
            for i, name in enumerate(self._tuning.joints)
            if misfits[i]
        ]

    # --- one tick ---------------------------------------------------------------------------

    def step(self, time_s: float, dt: float, observed: Observed) -> Decision:
        """Decide what the drives do until the next tick; dt [s] since the last decision."""
        self._observed = observed
        self.doubt(time_s, observed.findings)
        if self.machine.mode in SENSING:
            self._feel(time_s, observed)
        self._progress(time_s, observed)
        desired = self._desired_velocity(dt, observed)
        # A joint that was not heard of in this tick has moved on as it was told to.
        q = observed.q + self._velocity * observed.age_s
        self._velocity = self._limits.bound_velocity(q, desired, self._velocity, dt)
        if self.machine.mode not in SENSING:
            self._velocity = np.zeros_like(self._velocity)
        resetting = time_s < self._reset_until_s
        return Decision(self._power(), resetting, self._velocity, self._reference)

    def doubt(self, time_s: float, findings: tuple[Finding, ...]) -> None:
        """React to what the supervisor found; also before there is anything to decide on."""
        if time_s < self._reset_until_s:
            findings = tuple(f for f in findings if f.condition is not Condition.DRIVE_FAULT)
        finding = strongest(findings)
        event = finding and EVENT_OF[finding.reaction]
        if event:
            self._apply(event, str(finding), time_s)

    def _feel(self, time_s: float, observed: Observed) -> None:
        if observed.thresholded.any():
            self._touched_s = time_s
        self.quiet_s = time_s - self._touched_s
        if observed.touched and self.machine.armed:
            self._apply(Event.TOUCH, observed.touched, time_s)
        elif observed.hit and not self.machine.armed:
            self._apply(Event.COLLISION, observed.hit, time_s)

    def _progress(self, time_s: float, observed: Observed) -> None:
        """Events of the arm's own: energised, at rest, quiet, at a bound, too late."""
        elapsed = time_s - self.machine.entered_s
        match self.machine.mode:
            case Mode.ENABLING:
                if observed.energised:
                    self._apply(Event.ENERGISED, "drives enabled", time_s)
                elif elapsed > self._tuning.enable_timeout_s:
                    text = f"the drives were not enabled within {self._tuning.enable_timeout_s:g} s"
                    self._apply(Event.TIMEOUT, text, time_s)
            case Mode.STOPPING:
                still = np.abs(observed.motor_velocity) < STANDSTILL_SPEED
                if still.all() and not self._velocity.any():
                    self._apply(Event.STANDSTILL, self.machine.cause, time_s)
                elif elapsed > self._tuning.stop_timeout_s:
                    text = f"the arm did not stop within {self._tuning.stop_timeout_s:g} s"
                    self._apply(Event.TIMEOUT, text, time_s)
            case Mode.ADMITTANCE:
                self._progress_admittance(time_s, elapsed, observed)

    def _progress_admittance(self, time_s: float, elapsed: float, observed: Observed) -> None:
        if bound := self._law.bound_reached(elapsed, observed.q - self._entry):
            self._apply(Event.BOUND, bound, time_s)
        # Ticks are whole periods; half a millisecond keeps their sum's rounding out of it.
        elif self.quiet_s >= self._tuning.quiet_s - 5e-4:
            quiet = f"quiet for {self.quiet_s:.2f} s"
            misfits = self._misfits(observed.q)
            if self.machine.moving and not misfits:
                self._apply(Event.RESUME, quiet, time_s)
            else:
                self._apply(Event.SETTLE, "; ".join([quiet, *misfits]), time_s)

    def _apply(self, event: Event, cause: str, time_s: float) -> None:
        """Follow the table, and set up what the new mode starts from: the measured pose."""
        before = self.machine.mode
        if not self.machine.apply(event, cause, time_s) or self._observed is None:
            return
        after = self.machine.mode
        if event is Event.RESET:
            self._reset_until_s = time_s + RESET_PATIENCE_S
        if after is before:
            return
        self._reference = self._observed.q.copy()
        if after is Mode.TRACKING:
            self._follower.anchor(self._reference)
        elif after is Mode.ADMITTANCE:
            self._entry = self._reference
            self._touched_s = time_s
            self.quiet_s = 0.0

    def _desired_velocity(self, dt: float, observed: Observed) -> Vector:
        match self.machine.mode:
            case Mode.OFF | Mode.ENABLING | Mode.STOPPING | Mode.FAULTED:
                return np.zeros_like(self._velocity)
            case Mode.HOLDING:
                return self._tuning.position_gain * (self._reference - observed.q)
            case Mode.TRACKING:
                reference = self._follower.step(dt)
                self._reference = reference.q
                error = reference.q - observed.q
                return reference.velocity + self._tuning.position_gain * error
            case Mode.ADMITTANCE:
                pushed = self._law.velocity_after(self._velocity, observed.thresholded, dt)
                return self._limits.soft_stop(observed.q, pushed, self._tuning.position_gain)
            case mode:
                assert_never(mode)

    def _power(self) -> tuple[PowerTarget, ...]:
        match self.machine.mode:
            case Mode.OFF:
                # A joint that must not fall stays in quick stop, where its drive holds it.
                return tuple(
                    PowerTarget.QUICK_STOP if end == "hold" else PowerTarget.OFF
                    for end in self._tuning.ends
                )
            case Mode.FAULTED:
                return (PowerTarget.QUICK_STOP,) * len(self._tuning.joints)
            case _:
                return (PowerTarget.ON,) * len(self._tuning.joints)
