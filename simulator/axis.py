"""Power stage of one drive: CiA 402 states, setpoints, limits and stops."""

from collections.abc import Callable

import numpy as np

from simulator.objects import Objects, key
from simulator.state_machine import HOLDING_OPTIONS, State, Trigger, on_controlword, step
from simulator.surroundings import Surroundings

CSV = 9
VOLTAGE_PRESENT, REMOTE, LIMIT_ACTIVE, FOLLOWS = 1 << 4, 1 << 9, 1 << 11, 1 << 12
CONTROLWORD, STATUSWORD, TARGET_VELOCITY = key(0x6040), key(0x6041), key(0x60FF)
MODE, MODE_DISPLAY = key(0x6060), key(0x6061)
CONNECTION_LOST: tuple[tuple[str, Trigger | None], ...] = (
    ("no action, continuing", None),
    ("fault", Trigger.FAULT_DETECTED),
    ("voltage disabled", Trigger.DISABLE_VOLTAGE),
    ("quick stop", Trigger.QUICK_STOP),
)
"""Reaction by the value of 6007 (abort connection option code)."""


class Axis:
    """Power stage of one drive. It reads the drive's objects and writes its entries of the servo;
    frames and time are handled by the drive.

    `report` receives a sentence when a stop ends.
    """

    def __init__(
        self, joint: int, wired: Surroundings, objects: Objects, report: Callable[[str], None]
    ) -> None:
        self._joint, self._objects, self._report = joint, objects, report
        self._servo, self._plant = wired.servo, wired.plant
        self._about = about = wired.description.joints[joint]
        self._profile = profile = wired.drives[joint].make
        self.unit = profile.velocity_unit / about.gear
        """Value of one count of 60FF at the link side [rad/s]."""
        self.braking_unit = profile.acceleration_unit / about.gear
        """Value of one count of 6085 at the link side [rad/s^2]."""
        self._set_state(State.NOT_READY_TO_SWITCH_ON)
        self.stopping = False
        """True during the ramp of a quick stop or fault reaction: call `stop_further`."""
        self._controlword = 0
        # Last input that caused no transition, as almost always: a cache.
        self._stays: tuple[State, int, int, int] | None = None
        self._fastest = self._interpolation_s = 0.0

    def start(self) -> None:
        """Power up: limp, switch on disabled, limits from the objects."""
        self._set_state(State.NOT_READY_TO_SWITCH_ON)
        self._controlword = 0
        self.happen(Trigger.INITIALISED)
        self.configure()

    def configure(self) -> None:
        """Read limits and the interpolation period from the objects."""
        number = self._objects.number
        values, profile = self._objects.values, self._profile
        # A drive may limit its torque, its current, or both.
        limits = [number(index) for index in (0x6072, 0x6073) if key(index) in values]
        most = 0.001 * min(limits) * self._about.rated_current_A if limits else np.inf
        self._servo.limit(self._joint, min(most, self._about.max_current_A))
        fastest = profile.speed_limit
        self._fastest = np.inf
        if fastest is not None:
            limit = number(fastest >> 8, fastest & 0xFF)
            self._fastest = limit * profile.speed_unit / self._about.gear
        interpolates = key(0x60C2, 1) in values
        self._interpolation_s = (
            number(0x60C2, 1) * 10.0 ** number(0x60C2, 2)
            if interpolates
            else profile.interpolation_s
        )

    def statusword(self, remote: bool) -> int:
        """Statusword 6041: bit 9 if `remote`, 11 at the current limit, 12 if it follows 60FF."""
        word = self._word | REMOTE if remote else self._word
        if self.state is State.OPERATION_ENABLED:
            if self._objects.values[MODE] == CSV:
                word |= FOLLOWS
            if self._servo.saturated(self._joint):
                word |= LIMIT_ACTIVE
        return word

    def on_controlword(self) -> None:
        """React to a write of 6040."""
        number = self._objects.number
        previous, self._controlword = self._controlword, number(0x6040)
        asked = (self.state, previous, self._controlword, number(0x605A))
        if asked == self._stays:
            return
        after = on_controlword(*asked)
        if after is self.state:
            self._stays = asked
        else:
            self._enter(after)

    def on_mode(self) -> None:
        """React to a write of 6060."""
        self._objects.show(MODE_DISPLAY, self._objects.number(0x6060))
        self.on_target()

    def on_target(self) -> None:
        """React to a write of 60FF: approach it over the interpolation period of 60C2."""
        if self.state is State.OPERATION_ENABLED and self._objects.values[MODE] == CSV:
            velocity = self._objects.number(0x60FF) * self.unit
            velocity = min(max(velocity, -self._fastest), self._fastest)
            self._servo.follow(self._joint, velocity, self._interpolation_s)

    def happen(self, event: Trigger) -> None:
        """React to an internal event, as opposed to a controlword."""
        after = step(self.state, event, self._objects.number(0x605A))
        if after is not self.state:
            self._enter(after)

    def stop_further(self) -> None:
        """End a quick stop or fault reaction once its ramp has ended."""
        energised = self._servo.energised(self._joint)
        if energised and not self._servo.arrived(self._joint):
            return
        self.stopping = False
        if self.state is State.FAULT_REACTION_ACTIVE:
            self.happen(Trigger.REACTION_DONE)
        elif not energised:
            self.happen(Trigger.DISABLE_VOLTAGE)
        elif self._objects.number(0x605A) in HOLDING_OPTIONS:
            self._report("standing, holding")
        else:
            self.happen(Trigger.QUICK_STOP_DONE)

    def lose_connection(self, reason: str) -> None:
        """React as configured in 6007 if in operation, and report the reason."""
        if self.state is State.OPERATION_ENABLED:
            words, event = CONNECTION_LOST[self._objects.number(0x6007)]
            self._report(f"{reason}, {words}")
            if event is not None:
                self.happen(event)

    def _set_state(self, state: State) -> None:
        self.state, self._word = state, state.value | VOLTAGE_PRESENT

    def _enter(self, state: State) -> None:
        servo, joint = self._servo, self._joint
        self._set_state(state)
        self.stopping = False
        if state is State.OPERATION_ENABLED:
            if not servo.energised(joint):
                servo.energise(joint, float(self._plant.theta_dot[joint]))
            servo.ramp(joint, 0.0, self._objects.number(0x6085) * self.braking_unit)
            self._brake()
            self.on_target()
        elif state in (State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE):
            option = self._objects.number(0x605A if state is State.QUICK_STOP_ACTIVE else 0x605E)
            if option == 0:
                servo.release(joint)
            servo.ramp(joint, 0.0, self._objects.number(0x6085) * self.braking_unit)
            self.stopping = True
        else:
            servo.release(joint)
            self._brake()

    def _brake(self) -> None:
        if self._about.brake:
            self._plant.brake(self._joint, not self._servo.energised(self._joint))
