"""Bounds that physics gives to what decides whether a touch is felt.

Whatever a configuration says, some figures make an arm that feels nothing: a level above all that
its motor can press with, friction that no motor could turn, links that no motor could hold. They
are refused, with what they are measured by; what comes near is told (`contactd check`).

Everything is measured by the motor's largest torque, by the weight and the reach of the arm, and
by the range of the joint. So the first of all are bounded, too: a torque constant that is a hundred
times too large would make room for a level that is a hundred times too high.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from daemon.config.dynamics import model_of
from daemon.config.problem import Keys, Problem, at, figure
from daemon.config.schema import Configuration, Joint
from daemon.config.worst_loads import Load, worst_loads
from daemon.faults.detector import patience_deaf
from estimator.estimate import SENSED_PERIODS
from estimator.transmission import stiction_range
from estimator.urdf import MovedLink, moved_links

GRAVITY = 9.81  # [m/s2]

NEAR = 0.7
"""Share of a bound from which on it is told: every arm shipped stays below."""
FELT = 0.5
"""Share of the motor's largest torque that a touch of a moving joint, friction, or what a rotor
takes may be. Half is left for whoever is pressed: beyond, the motor gives out before it feels."""
LEAST = 0.001
"""Share of the motor's largest torque that a touch may be at least."""
HEAVIEST = 30.0
"""Times all other moving links together that one of three or more may weigh."""
STRONGEST_BLOW = 3.0
"""Times the motor's largest torque: more than the gears of such motors are built for at once."""
TOO_HEAVY = 2.0
"""Times the motor's largest torque: it could not hold half of that."""
TOO_STRONG = 50.0
"""Times the weight of the arm at its reach: no motor of an arm is chosen so."""
LEAST_REACH = 0.5
"""What counts as reach of an arm whose links are balanced about its axis, or short [m]."""
SURGE = 10.0
"""Times the rated current: no motor is made for more."""
SHAFT = (1e-4, 10.0)
"""Torque constants of motors, at their shaft [Nm/A]."""
OF_RANGE = 1.0 / 8.0
"""Share of its range that a joint may fall through its gap, from border to border."""
WIDEST_HALF_GAP = 0.2  # [rad]; a gear with more has no teeth left
LONGEST_TIMEOUT_MS = 500
"""That a drive may move on when its master is silent."""
LATEST_S = 0.15
"""[s] until a steady torque of twice its level must be felt."""
BENDING = 0.005  # [rad]; what a gear bends under the motor's largest torque, at least


@dataclass(frozen=True, slots=True)
class Bounded:
    """One figure, its place in the file, and the bounds that physics gives it."""

    keys: Keys
    where: str
    value: float
    high: float
    unit: str
    why: str
    low: float = 0.0

    @property
    def refused(self) -> bool:
        """True beyond the bounds; what is no number is."""
        return not self.low <= self.value <= self.high

    @property
    def near(self) -> bool:
        """True where little is left to a bound."""
        return not self.low <= NEAR * self.value <= NEAR * NEAR * self.high

    @property
    def problem(self) -> Problem:
        """What is wrong, or soon will be, in words."""
        low, high = figure(self.low), figure(self.high)
        what = f"{self.value:.4g} {self.unit} {'is beyond' if self.refused else 'comes near'}"
        allowed = f"{low} to {high}" if self.low else f"up to {high}"
        if math.isinf(self.high):
            allowed = f"from {low} on"
        return Problem(
            self.keys, self.where, f"{what} what can be: {allowed} {self.unit}, {self.why}"
        )


def beyond(c: Configuration, urdf: str) -> list[Problem]:
    """Problems with all that is beyond its bounds. The URDF must be one that can be read, and the
    limits of the joints in order."""
    missing = list(_weightless(c, urdf))
    return missing or [b.problem for b in bounded(c, urdf) if b.refused]


def near(c: Configuration, urdf: str) -> list[Problem]:
    """What comes near its bounds, of a configuration that is within them."""
    return [*_deaf(c), *(b.problem for b in bounded(c, urdf) if b.near and not b.refused)]


def bounded(c: Configuration, urdf: str) -> Iterator[Bounded]:
    """Every bounded figure of a configuration."""
    model = model_of(c, urdf)
    reach = max(model.reach, LEAST_REACH)
    weight = GRAVITY * model.mass * reach
    yield from _sensing(c)
    for i, (joint, load) in enumerate(zip(c.joints, worst_loads(c, urdf), strict=True)):
        yield from _motor(i, joint, weight)
        yield from _levels(i, joint, load.motor, c)
        yield from _transmission(i, joint, load.motor)
        yield from _links(c, joint, load)
    links = moved_links(urdf)
    for link in links:
        yield _shape(c, link, reach)
    if sum(link.mass > 0.0 for link in links) > 2:
        for link in links:
            yield _mass(c, link, sum(other.mass for other in links) - link.mass)


def _deaf(c: Configuration) -> Iterator[Problem]:
    """What may take longer than a touch should. Not refused: such an arm holds all the same."""
    stale_s = c.supervisor.stale_ticks * c.period_s
    if stale_s > LATEST_S:
        yield Problem(
            ["supervisor", "stale_ticks"],
            "supervisor.stale_ticks",
            f"{c.supervisor.stale_ticks} ticks: a drive that sends nothing is found after "
            f"{stale_s:.3g} s, more than {LATEST_S:g} s, in which nobody knows where its joint "
            "goes",
        )
    for name, profile in c.drives.items():
        if profile.master_timeout_ms > LONGEST_TIMEOUT_MS:
            yield Problem(
                ["drives", name, "master_timeout_ms"],
                f"drives.{name}.master_timeout_ms",
                f"{profile.master_timeout_ms} ms: for so long its joints go on, at up to "
                f"limits.velocity, when the daemon has died; usual is 100, up to "
                f"{LONGEST_TIMEOUT_MS} is not told",
            )
    seconds = (SENSED_PERIODS + patience_deaf(c.period_s)) * c.period_s
    if seconds > LATEST_S:
        yield Problem(
            ["period_ms"],
            "period_ms",
            f"{c.period_ms} ms: where samples go missing, the arm stops or holds only after "
            f"{seconds:.2g} s in which a touch may not be felt; up to 40 ms it takes at most "
            f"{LATEST_S:g} s",
        )


def _sensing(c: Configuration) -> Iterator[Bounded]:
    # By the end of a tick, in which it is found.
    slowest = math.log(2.0) / max(LATEST_S - c.period_s, 1e-9)
    why = (
        "so that a torque of twice its level is felt within ln 2 / gain and a period = "
        f"{LATEST_S:g} s"
    )
    gain = c.estimator.gain
    yield Bounded(["estimator", "gain"], "estimator.gain", gain, math.inf, "/s", why, slowest)
    left = max(0.0, LATEST_S - c.period_s - math.log(2.0) / gain)
    ticks = 1.0 + left / c.period_s
    yield Bounded(
        ["estimator", "debounce"],
        "estimator.debounce",
        # One tick is no debounce at all, however little time is left.
        float(c.estimator.debounce) if c.estimator.debounce > 1 else 0.0,
        ticks,
        "ticks",
        f"so that a torque of twice its level is felt within {LATEST_S:g} s, ln 2 / gain and "
        "debounce together",
    )


def _motor(i: int, joint: Joint, weight: float) -> Iterator[Bounded]:
    wiring = joint.wiring
    low, high = (wiring.gear * constant for constant in SHAFT)
    why = f"{SHAFT[0]:g} to {SHAFT[1]:g} Nm/A at the shaft of a motor, behind a gear of " + (
        f"{wiring.gear:g}"
    )
    constant = joint.torque_constant
    yield Bounded(*at(i, joint, "torque_constant"), constant, high, "Nm/A", why, low)
    yield Bounded(
        *at(i, joint, "torque_constant"),
        constant,
        TOO_STRONG * weight / wiring.max_current_A,
        "Nm/A",
        f"with which the motor holds {TOO_STRONG:g} times the weight of the whole arm at its reach "
        f"({weight:.3g} Nm by the URDF) at max_current_A: are masses in kg and lengths in m?",
    )
    yield Bounded(
        *at(i, joint, "wiring", "max_current_A"),
        wiring.max_current_A,
        SURGE * wiring.rated_current_A,
        "A",
        f"{SURGE:g} times rated_current_A: no motor is made for more",
    )


def _levels(i: int, joint: Joint, motor: float, c: Configuration) -> Iterator[Bounded]:
    levels, friction, settings = joint.thresholds, joint.friction, c.estimator
    of = _of(motor)
    high = FELT * motor
    yield Bounded(
        *at(i, joint, "thresholds", "contact"),
        levels.contact,
        high,
        "Nm",
        f"{LEAST:g} to {FELT:g} of {of}: beyond, it presses with nearly all it has and feels "
        "nothing; below, its current's noise is a touch",
        LEAST * motor,
    )
    speed = joint.limits.velocity
    yield Bounded(
        *at(i, joint, "thresholds", "per_speed"),
        levels.per_speed,
        max(0.0, high - levels.contact) / speed,
        "Nm s/rad",
        f"with which contact and what is added at limits.velocity come to {high:.4g} Nm, {FELT:g} "
        f"of {of}",
    )
    yield Bounded(
        *at(i, joint, "thresholds", "collision"),
        levels.collision,
        STRONGEST_BLOW * motor,
        "Nm",
        f"{STRONGEST_BLOW:g} times {of}: more than the gear of such a motor stands",
    )
    share = settings.stiction_share + stiction_range(friction.stiction)[1]
    coulomb = friction.motor_coulomb + friction.link_coulomb
    unsure = settings.unknown_side_share if joint.half_gap > 0 else 0.0
    yield Bounded(
        *at(i, joint, "thresholds"),
        (1.0 + unsure) * levels.contact + share * coulomb,
        motor,
        "Nm at rest",
        f"{of}: contact, raised by what friction ({share:g} of {coulomb:g} Nm: "
        "estimator.stiction_share and friction.stiction) and a side of the gap that is not known "
        "may hide, would be more than it can press with",
    )


def _transmission(i: int, joint: Joint, motor: float) -> Iterator[Bounded]:
    limits, friction, of, high = joint.limits, joint.friction, _of(motor), FELT * motor
    span = limits.upper - limits.lower
    yield Bounded(
        *at(i, joint, "half_gap"),
        joint.half_gap,
        min(0.5 * OF_RANGE * span, WIDEST_HALF_GAP),
        "rad",
        f"at which the joint falls freely through {OF_RANGE:g} of its range of {span:.4g} rad, and "
        f"never more than {WIDEST_HALF_GAP:g} rad",
    )
    for name in ("motor_coulomb", "link_coulomb", "gap_coulomb"):
        yield Bounded(
            *at(i, joint, "friction", name),
            getattr(friction, name),
            high,
            "Nm",
            f"{FELT:g} of {of}: little would be left to move the joint",
        )
    for name in ("motor_viscous", "link_viscous", "gap_viscous"):
        yield Bounded(
            *at(i, joint, "friction", name),
            getattr(friction, name),
            high / limits.velocity,
            "Nm s/rad",
            f"with which friction at limits.velocity takes {FELT:g} of {of}",
        )
    yield Bounded(
        *at(i, joint, "rotor_inertia"),
        joint.rotor_inertia,
        high / limits.acceleration,
        "kg m2",
        f"with which the rotor takes {FELT:g} of {of} at limits.acceleration",
    )
    yield Bounded(
        *at(i, joint, "gap_spring", "stiffness"),
        joint.gap_spring.stiffness,
        motor / BENDING,
        "Nm/rad",
        f"with which {of} bends the gear by {BENDING:g} rad: the correction would be all of it",
    )
    yield Bounded(
        *at(i, joint, "gap_spring", "damping"),
        joint.gap_spring.damping,
        high / limits.velocity,
        "Nm s/rad",
        f"with which the correction at limits.velocity is {FELT:g} of {of}",
    )


def _links(c: Configuration, joint: Joint, load: Load) -> Iterator[Bounded]:
    of = f"{TOO_HEAVY:g} times {_of(load.motor)}: are masses in kg and lengths in m?"
    high, place = TOO_HEAVY * load.motor, f"urdf ({c.urdf}), joint {joint.name}"
    yield Bounded(["urdf"], f"{place}: gravity at worst", load.gravity, high, "Nm", of)
    needed, a = load.inertia * joint.limits.acceleration, joint.limits.acceleration
    what = f"{place}: inertia of {load.inertia:.4g} kg m2 at limits.acceleration ({a:g} rad/s2)"
    yield Bounded(["urdf"], what, needed, high, "Nm", of)


def _mass(c: Configuration, link: MovedLink, others: float) -> Bounded:
    return Bounded(
        ["urdf"],
        f"urdf ({c.urdf}), line {link.line}: link {link.name!r}",
        link.mass,
        HEAVIEST * others,
        "kg",
        f"{HEAVIEST:g} times all other moving links together: is it in kg?",
    )


def _shape(c: Configuration, link: MovedLink, reach: float) -> Bounded:
    return Bounded(
        ["urdf"],
        f"urdf ({c.urdf}), line {link.line}: link {link.name!r}",
        link.moment,
        link.mass * (0.5 * reach) ** 2,
        "kg m2",
        f"its mass of {link.mass:g} kg at half the reach of the whole arm ({reach:.3g} m)",
    )


def _weightless(c: Configuration, urdf: str) -> Iterator[Problem]:
    """Joints whose own body has no mass or inertia: frames on it may be without."""
    links = moved_links(urdf)
    for name in c.joint_names:
        body = [link for link in links if link.joint == name]
        mass = sum(link.mass for link in body)
        if mass > 0 and any(link.moment > 0 for link in body):
            continue
        what = "no inertia about its centre of mass" if mass > 0 else "no mass"
        yield Problem(
            ["urdf"],
            f"urdf ({c.urdf}), line {body[0].line}",
            f"link {body[0].name!r}, which joint {name} moves, has {what}: it needs an <inertial> "
            "with mass, in kg, and inertia above 0, or its weight is taken for a touch",
        )


def _of(motor: float) -> str:
    return f"the motor's {motor:.4g} Nm (torque_constant times max_current_A)"
