"""Scripted human hand: it holds joints by spring-dampers, pushes, guides, releases, and gives the
arm loads to carry."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from common.arrays import Vector
from common.errors import ConfigurationError
from simulator.hand_script import (
    STRONGEST,
    AnyAct,
    Gap,
    Give,
    Guide,
    Lean,
    Press,
    Push,
    Release,
    described,
    joints_of,
)

TAKING_S, VISIT_S, WAY_S = 1.5, 0.9, 0.25
"""Times of the act `gap` [s]: taking up the weight of the link; from one border to the next, and
the share of that for moving."""
SOFT = 0.01
"""Share of a motor's torque limit with which a hand can press without turning the motor."""
LEADING, OVER_FRICTION = 0.2, 4.0
"""Largest pull of a hand that leads the arm without a collision being detected, as a share of the
motor's torque limit and as a multiple of the joint's friction: identified levels are that small."""


class Hand:
    """Player of a script: call `update` once per millisecond, `torque` at every plant step.

    damping_limit: (n,) largest damping, as a stronger damper on a light link would be numerically
    unstable at the plant's step.
    """

    def __init__(
        self,
        script: Sequence[AnyAct],
        names: Sequence[str],
        damping_limit: Vector,
        give: Callable[[Give], None] = lambda _: None,
        weight: Callable[[Vector], Vector] = np.zeros_like,
        at_tool: Callable[[Vector, Vector], Vector] = lambda q, _: np.zeros_like(q),
        strongest: Vector | float = 100.0,
        friction: Vector | float = np.inf,
        stops: tuple[Vector | float, Vector | float] = (-np.inf, np.inf),
    ) -> None:
        """give: makes the arm carry a load. weight: torque that holds the links at q (n,).
        at_tool: joint torque of a force on the tool (3,) [N] at q (n,).
        strongest: torque limits of the motors; friction: of the joints, (n,) [Nm].
        stops: end stops of the joints, (n,) each [rad].
        Raises ConfigurationError if the script names an unknown joint."""
        self._script = sorted(script, key=lambda act: act.at_s)
        self._index: Mapping[str, int] = {name: i for i, name in enumerate(names)}
        for act in self._script:
            self._refuse_unknown(act, "hand script: ")
        n = len(names)
        self._damping_limit = damping_limit
        self._lower, self._upper = (np.broadcast_to(stop, n) for stop in stops)
        self._next = 0
        self._began_at: float | None = None
        self._pushes: list[tuple[Push | Lean | Press, float]] = []
        # Act, its largest torque [Nm], start time [s], middle position [rad].
        self._gap: tuple[Gap, float, float, float] | None = None
        self._soft = SOFT * np.broadcast_to(strongest, n)
        self._leading = np.minimum(LEADING * np.broadcast_to(strongest, n), STRONGEST)
        held = np.broadcast_to(friction, n)
        self._leading = np.where(
            held > 0.0, np.minimum(self._leading, OVER_FRICTION * held), self._leading
        )
        self._asked: list[AnyAct] = []
        self._anchor, self._goal, self._speed, self._rate = np.zeros((4, n))
        self._stiffness, self._damping, self._strongest = np.zeros((3, n))
        self._pushing, self._scratch = np.zeros((2, n))
        self._holding = self._guiding = False
        self._give, self._weight, self._at_tool, self._now = give, weight, at_tool, 0.0

    def _refuse_unknown(self, act: AnyAct, place: str = "") -> None:
        for joint in joints_of(act):
            if joint not in self._index:
                known = ", ".join(self._index)
                raise ConfigurationError(f"{place}no joint {joint!r}; there are: {known}")

    def take(self, act: AnyAct) -> str:
        """Begin an act now, whatever its `at_s`; returns it as text. Raises ConfigurationError for
        an unknown joint, and for a position beyond its end stops."""
        self._refuse_unknown(act)
        for name, goal in act.to.items() if isinstance(act, Guide) else ():
            lower, upper = self._lower[self._index[name]], self._upper[self._index[name]]
            if not lower <= goal <= upper:
                raise ConfigurationError(
                    f"{name}: {goal:g} rad is beyond its end stops, {lower:g} to {upper:g} rad"
                )
        self._asked.append(act)
        if not isinstance(act, Guide):
            return described(act)
        pulls = [
            self._leading[self._index[name]] if act.max_torque is None else act.max_torque
            for name in act.to
        ]
        return f"{described(act)}, with at most {', '.join(f'{most:.2g} Nm' for most in pulls)}"

    @property
    def busy(self) -> bool:
        """True while a requested act has not ended."""
        return bool(self._asked) or self.touching

    @property
    def began(self) -> bool:
        """True while the script's clock runs."""
        return self._began_at is not None

    @property
    def touching(self) -> bool:
        """True while the hand exerts torque."""
        return self._holding or bool(self._pushes) or self._gap is not None

    @property
    def done(self) -> bool:
        """True once every act has begun and the hand exerts no more torque."""
        return self._next == len(self._script) and not self.touching

    def begin(self, t: float) -> None:
        """Start the script's clock."""
        self._began_at = t

    def update(self, t: float, q: Vector, period_s: float = 0.001) -> list[str]:
        """Advance script and guided grip to time t; returns acts that began or ended, as text."""
        self._now = t
        words: list[str] = []
        while self._asked:
            act = self._asked.pop(0)
            self._start(act, t, q)
            words.append(f"begin {described(act)}")
        while self._began_at is not None and self._next < len(self._script):
            act = self._script[self._next]
            if t - self._began_at < act.at_s:
                break
            self._next += 1
            self._start(act, t, q)
            words.append(f"begin {described(act)}")
        if self._pushes:
            self._push(t, q, words)
        if self._guiding:
            self._lead(period_s, words)
        if self._gap is not None and t - self._gap[2] > TAKING_S + VISIT_S * self._gap[0].times:
            words.append(f"end {described(self._gap[0])}")
            self._gap = None
        return words

    def torque(self, q: Vector, q_dot: Vector, out: Vector) -> None:
        """Add the hand's joint torque (n,) [Nm] at q (n,), q_dot (n,) to `out`."""
        spring = self._scratch
        np.subtract(self._rate, q_dot, out=spring)
        np.multiply(spring, self._damping, out=spring)
        spring += self._stiffness * (self._anchor - q)
        np.minimum(spring, self._strongest, out=spring)
        np.maximum(spring, -self._strongest, out=spring)
        out += spring
        out += self._pushing
        if self._gap is not None:
            act, most, since, middle = self._gap
            i = self._index[act.joint]
            t = self._now - since
            taken = min(t / TAKING_S, 1.0)  # taken at once, the weight would push the motor away
            out[i] += taken * self._weight(q)[i]
            if t > TAKING_S:
                out[i] += self._between_borders(act, most, t - TAKING_S, middle - q[i])
            out[i] -= min(2.0 * most, self._damping_limit[i]) * q_dot[i]

    @staticmethod
    def _between_borders(act: Gap, most: float, t: float, way: float) -> float:
        """Torque alternately towards one border and the other, at most `most` [Nm]; way: from the
        link to the middle [rad]."""
        visit, phase = divmod(t, VISIT_S)
        lead = min(2.0 * phase / WAY_S - 1.0, 1.0) * (1.0 if int(visit) % 2 == 0 else -1.0)
        spring = 100.0 * most * (way + lead * act.reach)
        return min(max(spring, -most), most)

    def _start(self, act: AnyAct, t: float, q: Vector) -> None:
        if isinstance(act, Push | Lean | Press):
            self._pushes.append((act, t))
            return
        if isinstance(act, Gap):
            i = self._index[act.joint]
            most = float(self._soft[i]) if act.torque is None else act.torque
            self._gap = (act, most, t, float(q[i]))
            return
        if isinstance(act, Give):
            self._give(act)
            return
        if isinstance(act, Release):
            for vector in (self._stiffness, self._damping, self._strongest, self._rate):
                vector[:] = 0.0
            self._holding = self._guiding = False
            self._pushes = [(push, since) for push, since in self._pushes if isinstance(push, Push)]
            self._pushing[:] = 0.0
            self._gap = None
            return
        for name in joints_of(act):
            i = self._index[name]
            if self._stiffness[i] == 0.0:  # a hand that already holds continues from its anchor
                self._anchor[i] = q[i]
            most = float(self._leading[i]) if act.max_torque is None else act.max_torque
            self._stiffness[i], self._strongest[i] = act.stiffness, most
            self._damping[i] = min(act.damping, self._damping_limit[i])
            self._goal[i] = act.to[name] if isinstance(act, Guide) else self._anchor[i]
            self._speed[i] = act.speed if isinstance(act, Guide) else 0.0
        self._holding = bool(self._stiffness.any())
        self._guiding = self._guiding or isinstance(act, Guide)

    def _push(self, t: float, q: Vector, words: list[str]) -> None:
        self._pushing[:] = 0.0
        for act, since in tuple(self._pushes):
            lasts = None if isinstance(act, Lean) else act.duration_s
            if lasts is not None and t - since >= lasts:
                self._pushes.remove((act, since))
                words.append(f"end {described(act)}")
            elif isinstance(act, Push):
                share = (t - since) / act.duration_s
                form = {"step": 1.0, "ramp": share, "pulse": np.sin(np.pi * share)}[act.shape]
                self._pushing[self._index[act.joint]] += act.torque * form
            elif isinstance(act, Lean):
                self._pushing[self._index[act.joint]] += act.torque * _risen(act, t - since)
            else:
                self._pushing += self._at_tool(q, np.array(act.force) * _risen(act, t - since))

    def _lead(self, period_s: float, words: list[str]) -> None:
        way = self._goal - self._anchor
        reach = self._speed * period_s
        move = np.clip(way, -reach, reach)
        self._anchor += move
        self._rate[:] = move / period_s
        if not self._rate.any():
            self._guiding = False
            words.append("end lead, holding still")


def _risen(act: Lean | Press, after_s: float) -> float:
    return min(after_s / act.rise_s, 1.0)
