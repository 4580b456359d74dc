"""Rules that hold in every tick, whatever the hand, the faults and the people do."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.soak.record import Ledger
from bench.soak.sensing_rules import SensingRules
from bench.soak.stop_rules import StopRules
from common.arrays import Vector
from daemon.assembly import build_transmission
from daemon.config.schema import Configuration
from daemon.config.vectors import limits_of
from daemon.modes.table import GUIDED, SENSING, TRANSITIONS, YIELDING, Mode
from daemon.motion.release import SLACK_S
from daemon.protocol.state import State

AT_LIMIT = 0.005  # Nearer to its limit than this, a joint has been led back to it [rad]
LED_BACK_S = 1.0  # ...which takes so long after a hand has pressed it beyond [s]
# How long a quick stop may take [s], and the speed of a motor that stands [rad/s].
BRAKING_S = 1.0
STANDS = 0.05
# A fault that is gone must be reset and the arm be up again within this time [s].
COMES_BACK_S = 60.0
SWINGS_S = 1.0  # After the hand is off, an arm that swings in its gaps may still raise contacts [s]

LATCHED = (Mode.OFF, Mode.ENABLING, Mode.FAULTED)
STEPS = frozenset((before, after) for (before, _), after in TRANSITIONS.items())


class Watch:
    """Check of one State after the other; `ledger` keeps what was broken."""

    def __init__(self, c: Configuration, ledger: Ledger, gives_way: Vector | float) -> None:
        """gives_way (n,) [rad]: how far a hand may press the drives beyond a joint limit."""
        self.ledger = ledger
        self._gives_way = gives_way
        self._stops, self._sensing = StopRules(c, ledger), SensingRules(c, ledger)
        self.contacts_s: list[float] = []  # When a contact or a collision was reported.
        self._limits = limits_of(c)
        self._transmission = build_transmission(c)
        self._period_s = c.period_s
        self._names = c.joint_names
        self._reactions = c.reactions
        # Where the release that goes on began, and the way of the push.
        self._let_go_from: tuple[Vector, Vector] | None = None
        self._let_go_since_s = 0.0
        self._before: State | None = None
        self._setpoint = np.zeros(len(c.joints))
        self._quiet_since_s = 0.0
        self._overdue_ticks = 0
        self._up_s: float | None = None  # when the arm was last up, or excused

    def see(
        self,
        state: State,
        *,
        lease_until_s: float,
        lease_ticks: int,
        touched: bool,
        trouble: bool,
        q: Vector | None = None,
        theta: Vector | None = None,
        motor_velocity: Vector | None = None,
    ) -> None:
        """Check one State.

        lease_until_s: until when a client may have the arm armed (State.time_s), and lease_ticks:
        for how many ticks after that. touched: a hand is on the arm. trouble: a fault is being
        made. q and theta (n,) [rad], motor_velocity (n,) [rad/s]: the true ones, where they are
        known.
        """
        mode, now = Mode(state.mode), state.time_s
        setpoint = np.array(state.setpoint)
        measured = np.array(state.link_position)
        fresh = np.array(state.fresh)
        true_q = np.where(fresh, measured, 0.0) if q is None else q
        self._bounds(state, mode, setpoint, measured, fresh)
        self._permission(state, mode, now > lease_until_s, lease_ticks)
        before = self._before
        if before is not None:
            self.ledger.check("time goes on", now > before.time_s, now, f"after {before.time_s}")
            if state.tick == before.tick + 1:
                self._step(before, state, setpoint, measured)
                self._causes(before, state)
            if before.mode != state.mode:
                self._quiet_since_s = now
        if touched or trouble or not fresh.all():
            self._quiet_since_s = now
        if mode in SENSING:
            self._position(now, true_q, fresh if q is None else np.ones_like(fresh))
        if mode in LATCHED and now > self._quiet_since_s + BRAKING_S:
            speed = np.array(state.motor_velocity) if motor_velocity is None else motor_velocity
            self._all("no motion while latched", np.abs(speed) < STANDS, now, speed, "rad/s")
        self._comes_back(state, mode, trouble)
        self._lets_go(state, mode, setpoint, measured)
        unknown = np.where(fresh, 0.0, np.nan)
        seen = np.array(state.motor_velocity) + unknown
        self._stops.see(
            state,
            joints=np.array([measured + unknown] if q is None or theta is None else [q, theta]),
            speed=seen if motor_velocity is None else motor_velocity,
            touched=touched,
            trouble=trouble,
        )
        self._sensing.see(state)
        contacts = [now for event in state.notices if event.kind == "contact"]
        self.contacts_s += contacts
        if contacts:
            # Elsewhere a brake carries what the residual takes for a touch.
            sensing = mode in SENSING or (before is not None and Mode(before.mode) in SENSING)
            self.ledger.check("contacts in modes that detect them", sensing, now, state.mode)
        self._before, self._setpoint = state, setpoint

    def _all(
        self, rule: str, holds: NDArray[np.bool_], now: float, values: Vector, unit: str
    ) -> None:
        words = ""
        if not holds.all():
            wrong = np.flatnonzero(~holds)
            words = ", ".join(f"{self._names[i]} {values[i]:.4f} {unit}" for i in wrong)
        self.ledger.check(rule, bool(holds.all()), now, words)

    def _bounds(
        self, state: State, mode: Mode, setpoint: Vector, measured: Vector, fresh: NDArray[np.bool_]
    ) -> None:
        limits, now = self._limits, state.time_s
        within = np.abs(setpoint) <= limits.velocity + 1e-9
        self._all("setpoints within the velocity limit", within, now, setpoint, "rad/s")
        if mode in SENSING:
            down, up = self._room(state, measured)
            out = (up <= 0.0) & (setpoint > 0.0) | (down <= 0.0) & (setpoint < 0.0)
            self._all("no setpoint leads out of a limit", ~(out & fresh), now, setpoint, "rad/s")
        else:
            self._all("no setpoint while latched", setpoint == 0.0, now, setpoint, "rad/s")

    def _room(self, state: State, measured: Vector) -> Vector:
        """Room of each link, in its gap, to its lower and upper limit (2, n) [rad]."""
        play = self._transmission.play(np.array(state.phi), np.array(state.phi_sigma))
        to_limits = np.array((measured - self._limits.lower, self._limits.upper - measured))
        return np.asarray(to_limits - play)

    def _position(self, now: float, q: Vector, known: NDArray[np.bool_]) -> None:
        """A push that the drive gives way to is all that gets a joint beyond its limit, and from
        there it is led back."""
        limits = self._limits
        beyond = np.where(known, np.maximum(limits.lower - q, q - limits.upper), 0.0)
        self._all("no joint beyond its limit", beyond <= self._gives_way, now, q, "rad")
        if now > self._quiet_since_s + LED_BACK_S:
            self._all("joints led back to their limits", beyond <= AT_LIMIT, now, q, "rad")

    def _permission(self, state: State, mode: Mode, overdue: bool, allowed_ticks: int) -> None:
        check, now = self.ledger.check, state.time_s
        self._overdue_ticks = self._overdue_ticks + 1 if state.armed and overdue else 0
        if state.armed:
            late = self._overdue_ticks
            check("armed no longer than the lease", late <= allowed_ticks, now, f"{late} ticks")
            check("not armed while latched", mode not in LATCHED, now, state.mode)

    def _lets_go(self, state: State, mode: Mode, setpoint: Vector, measured: Vector) -> None:
        """A release is slow, bounded, and goes the way it was pushed, or only brakes."""
        if mode is not Mode.RELEASING:
            self._let_go_from = None
            return
        if self._let_go_from is None:
            self._let_go_from = measured, np.sign(np.array(state.thresholded))
            self._let_go_since_s = state.time_s
        now, (start, way) = state.time_s, self._let_go_from
        brakes = np.abs(setpoint) <= np.abs(self._setpoint) + 1e-9
        there = np.where(way == 0.0, setpoint == 0.0, way * setpoint >= 0.0)
        self._all("a release goes the way of the push", there | brakes, now, setpoint, "rad/s")
        slow = np.abs(setpoint) <= self._reactions.release_velocity + 1e-9
        self._all("a release is slow", slow | brakes, now, setpoint, "rad/s")
        near = way * (measured - start) <= self._reactions.release_distance + AT_LIMIT
        self._all("a release is bounded in distance", near | brakes, now, measured, "rad")
        moves_s = self._reactions.release_distance / self._reactions.release_velocity
        most_s = moves_s + SLACK_S + self._period_s
        within = now - self._let_go_since_s <= most_s
        self.ledger.check("a release is bounded in time", within, now, state.cause)

    def _comes_back(self, state: State, mode: Mode, trouble: bool) -> None:
        now = state.time_s
        if self._up_s is None or trouble or mode not in LATCHED:
            self._up_s = now
        back = now <= self._up_s + COMES_BACK_S
        words = f"{state.cause}; {self.ledger.refusal}"
        self.ledger.check("the arm comes back after a fault", back, now, words)
        if not back:
            self._up_s = now

    def _step(self, before: State, state: State, setpoint: Vector, measured: Vector) -> None:
        """Acceleration: only the braking distance to a limit may ask for more, to brake; and a
        setpoint that a blocked motor did not reach is given up when the arm begins to yield."""
        if Mode(before.mode) not in SENSING or Mode(state.mode) not in SENSING:
            return
        limits = self._limits
        dt = min(state.time_s - before.time_s, 2.0 * self._period_s)
        step = setpoint - self._setpoint
        gentle = np.abs(step) <= limits.acceleration * dt + 1e-9
        brakes = np.abs(setpoint) < np.abs(self._setpoint)
        down, up = self._room(state, measured)
        room = np.where(self._setpoint > 0.0, up, down)
        forced = brakes & (np.abs(setpoint) >= limits.funnel(room) - 1e-6)
        begins = state.mode in YIELDING and state.mode != before.mode
        most = np.maximum(np.abs(self._setpoint), limits.acceleration * dt + 1e-9)
        given_up = begins & (np.abs(setpoint) <= most)
        at_age = ~np.array(state.fresh)  # where the arm is taken to be is not published then
        self._all(
            "velocity steps bounded",
            gentle | forced | given_up | (brakes & at_age),
            state.time_s,
            step,
            "rad/s",
        )

    def _causes(self, before: State, state: State) -> None:
        """Check that every change of mode or permission is reported, with its cause, and in the
        table."""
        check, now = self.ledger.check, state.time_s
        reported = [event.text.partition(": ") for event in state.notices if event.kind == "mode"]
        mode, steps = before.mode, [what for what, _, _ in reported if " -> " in what]
        steps = [what for what in steps if not what.startswith("gain of ")]
        for what in steps:
            first, _, second = what.partition(" -> ")
            known = (Mode(first), Mode(second)) in STEPS
            check("changes of mode are of the table", first == mode and known, now, what)
            mode = Mode(second)
        words = f"{before.mode} to {state.mode}, reported: {reported}"
        check("a change of mode is reported", mode == state.mode, now, words)
        check("a change has a cause", all(cause for _, _, cause in reported), now, words)
        armings = [what for what, _, _ in reported if what in ("armed", "disarmed")]
        last = armings[-1] == "armed" if armings else before.armed
        check("a change of permission is reported", last == state.armed, now, words)
        if Mode(state.mode) in GUIDED and Mode(before.mode) not in GUIDED:
            check("no unarmed arm is guided", before.armed or "armed" in armings, now)


def false_alarms(contacts_s: Sequence[float], touches_s: Sequence[tuple[float, float]]) -> int:
    """Contacts outside of every touch (from, to) and the swinging after it."""
    return sum(
        not any(begin <= t <= end + SWINGS_S for begin, end in touches_s) for t in contacts_s
    )
