"""Physical bounds on the parameters that decide whether a contact is detected.

With some values an arm would detect nothing: a level above the largest torque of its motor,
friction that no motor could overcome, links that no motor could hold. They are refused, with the
quantity that bounds them; values close to a bound are warnings (`contactd check`).

The bounds derive from the motor's largest torque, from the weight and the reach of the arm, and
from the range of the joint. These are therefore bounded first: a torque constant that is a hundred
times too large would admit a level that is a hundred times too high.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from daemon.config.delays import LATEST_S, delays
from daemon.config.problem import Keys, Problem, at, figure
from daemon.config.schema import Configuration, Joint, frames_of
from daemon.config.worst_loads import Load, worst_loads
from estimator.model import Model
from estimator.transmission import stiction_range

GRAVITY = 9.81  # [m/s2]

NEAR = 0.7
"""Share of a bound above which a value gives a warning; all arms in `configs/` stay below."""
MOST = 0.5
"""Largest share of the motor's largest torque for the contact level of a moving joint, for
friction, or for accelerating the rotor. Half is reserved for the contact itself: beyond, the motor
saturates before the contact is detected."""
LEAST = 0.001
"""Smallest contact level, as a share of the motor's largest torque."""
HEAVIEST = 30.0
"""Largest mass of one moving link, of three or more, over that of all others together."""
LARGEST_COLLISION = 3.0
"""Largest collision level over the motor's largest torque: the gears withstand no more."""
TOO_HEAVY = 2.0
"""Largest load over the motor's largest torque: a motor could not hold even half of that."""
TOO_STRONG = 50.0
"""Largest motor torque over the weight of the arm at its reach: no arm has such a motor."""
LEAST_REACH = 0.5
"""Smallest reach assumed, for arms with short or balanced links [m]."""
SURGE = 10.0
"""Largest peak current over the rated current: no motor is made for more."""
SHAFT = (1e-4, 10.0)
"""Range of torque constants of motors, at the shaft [Nm/A]."""
OF_RANGE = 1.0 / 8.0
"""Largest width of a joint's gap as a share of its range."""
WIDEST_HALF_GAP = 0.2  # [rad]; no gear that meshes has more
BENDING = 0.005  # [rad]; smallest deflection of a gear under the motor's largest torque


@dataclass(frozen=True, slots=True)
class Bounded:
    """One value, its place in the file, and its physical bounds with their reason."""

    keys: Keys
    where: str
    value: float
    high: float
    unit: str
    why: str
    low: float = 0.0

    @property
    def refused(self) -> bool:
        """True if the value is outside its bounds, or NaN."""
        return not self.low <= self.value <= self.high

    @property
    def near(self) -> bool:
        """True if the value is within its bounds, but close to one."""
        return not self.low <= NEAR * self.value <= NEAR * NEAR * self.high

    @property
    def problem(self) -> Problem:
        """Problem that names the value, its bounds and their reason."""
        low, high = figure(self.low), figure(self.high)
        what = f"{self.value:.4g} {self.unit} is {'outside' if self.refused else 'near the end of'}"
        allowed = f"{low} to {high}" if self.low else f"up to {high}"
        if math.isinf(self.high):
            allowed = f"from {low} on"
        text = f"{what} the possible range: {allowed} {self.unit}, {self.why}"
        return Problem(self.keys, self.where, text)


def beyond(c: Configuration, model: Model) -> list[Problem]:
    """Problems of all values outside their bounds. Requires lower < upper in all joint limits."""
    missing = list(_weightless(c, model))
    return missing or [b.problem for b in bounded(c, model) if b.refused]


def near(c: Configuration, model: Model) -> list[Problem]:
    """Warnings about values close to their bounds, in a configuration that is within them."""
    return [*delays(c), *(b.problem for b in bounded(c, model) if b.near and not b.refused)]


def bounded(c: Configuration, model: Model) -> Iterator[Bounded]:
    """Every bounded value of a configuration."""
    reach = max(model.reach, LEAST_REACH)
    weight = GRAVITY * model.mass * reach
    yield from _sensing(c)
    for i, (joint, load) in enumerate(zip(c.joints, worst_loads(c, model), strict=True)):
        if not frames_of(c):
            continue  # `make: log`: nothing but logs is known of the motors
        yield from _motor(i, joint, weight)
        yield from _levels(i, joint, load.motor, c)
        yield from _transmission(i, joint, load.motor)
        yield from _links(c, joint, load)
    yield from _bodies(c, model, reach)


def _sensing(c: Configuration) -> Iterator[Bounded]:
    # A contact is detected at the end of a tick.
    slowest = math.log(2.0) / max(LATEST_S - c.period_s, 1e-9)
    why = (
        "so that a torque of twice its level is detected within ln 2 / gain and a period = "
        f"{LATEST_S:g} s"
    )
    gain = c.estimator.gain
    yield Bounded(["estimator", "gain"], "estimator.gain", gain, math.inf, "/s", why, slowest)
    left = max(0.0, LATEST_S - c.period_s - math.log(2.0) / gain)
    ticks = 1.0 + left / c.period_s
    yield Bounded(
        ["estimator", "debounce"],
        "estimator.debounce",
        # A debounce of one tick is none, and always allowed.
        float(c.estimator.debounce) if c.estimator.debounce > 1 else 0.0,
        ticks,
        "ticks",
        f"so that a torque of twice its level is detected within {LATEST_S:g} s, ln 2 / gain and "
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
    most = SURGE * wiring.rated_current_A
    why = f"{SURGE:g} times rated_current_A: no motor is made for more"
    yield Bounded(*at(i, joint, "wiring", "max_current_A"), wiring.max_current_A, most, "A", why)


def _levels(i: int, joint: Joint, motor: float, c: Configuration) -> Iterator[Bounded]:
    levels, friction, settings = joint.thresholds, joint.friction, c.estimator
    of = _of(motor)
    high = MOST * motor
    yield Bounded(
        *at(i, joint, "thresholds", "contact"),
        levels.contact,
        high,
        "Nm",
        f"{LEAST:g} to {MOST:g} of {of}: above, it pushes with nearly its full torque before a "
        "contact is detected; below, noise of its current is detected as a contact",
        LEAST * motor,
    )
    most = max(0.0, high - levels.contact) / joint.limits.velocity
    both = f"with which the contact level at limits.velocity is {high:.4g} Nm"
    why = f"{both}, {MOST:g} of {of}"
    yield Bounded(*at(i, joint, "thresholds", "per_speed"), levels.per_speed, most, "Nm s/rad", why)
    highest = LARGEST_COLLISION * motor
    why = f"{LARGEST_COLLISION:g} times {of}: more than the gear of such a motor withstands"
    yield Bounded(*at(i, joint, "thresholds", "collision"), levels.collision, highest, "Nm", why)
    share = settings.stiction_share + stiction_range(friction.stiction)[1]
    coulomb = friction.motor_coulomb + friction.link_coulomb
    unsure = settings.unknown_side_share if joint.half_gap > 0 else 0.0
    yield Bounded(
        *at(i, joint, "thresholds"),
        (1.0 + unsure) * levels.contact + share * coulomb,
        motor,
        "Nm at rest",
        f"{of}: contact, raised by what friction ({share:g} of {coulomb:g} Nm: "
        "estimator.stiction_share and friction.stiction) and an unknown side of the gap may hide, "
        "would exceed the torque it can push with",
    )


def _transmission(i: int, joint: Joint, motor: float) -> Iterator[Bounded]:
    limits, friction, of, high = joint.limits, joint.friction, _of(motor), MOST * motor
    span = limits.upper - limits.lower
    most = min(0.5 * OF_RANGE * span, WIDEST_HALF_GAP)
    falls = f"at which the joint falls freely through {OF_RANGE:g} of its range of {span:.4g} rad"
    why = f"{falls}, and never more than {WIDEST_HALF_GAP:g} rad"
    yield Bounded(*at(i, joint, "half_gap"), joint.half_gap, most, "rad", why)
    takes = f"with which friction at limits.velocity takes {MOST:g} of {of}"
    for kind, most, unit, why in (
        ("coulomb", high, "Nm", f"{MOST:g} of {of}: little would be left to move the joint"),
        ("viscous", high / limits.velocity, "Nm s/rad", takes),
    ):
        for name in (f"motor_{kind}", f"link_{kind}", f"gap_{kind}"):
            value = getattr(friction, name)
            yield Bounded(*at(i, joint, "friction", name), value, most, unit, why)
    why = f"with which the rotor takes {MOST:g} of {of} at limits.acceleration"
    most = high / limits.acceleration
    yield Bounded(*at(i, joint, "rotor_inertia"), joint.rotor_inertia, most, "kg m2", why)
    spring, bends = joint.gap_spring, f"with which {of} bends the gear by {BENDING:g} rad"
    why = f"{bends}: the correction would be all of that torque"
    most = motor / BENDING
    yield Bounded(*at(i, joint, "gap_spring", "stiffness"), spring.stiffness, most, "Nm/rad", why)
    why = f"with which the correction at limits.velocity is {MOST:g} of {of}"
    most = high / limits.velocity
    yield Bounded(*at(i, joint, "gap_spring", "damping"), spring.damping, most, "Nm s/rad", why)


def _links(c: Configuration, joint: Joint, load: Load) -> Iterator[Bounded]:
    of = f"{TOO_HEAVY:g} times {_of(load.motor)}: are masses in kg and lengths in m?"
    high, place = TOO_HEAVY * load.motor, f"urdf ({c.urdf}), joint {joint.name}"
    yield Bounded(["urdf"], f"{place}: gravity at worst", load.gravity, high, "Nm", of)
    needed, a = load.inertia * joint.limits.acceleration, joint.limits.acceleration
    what = f"{place}: inertia of {load.inertia:.4g} kg m2 at limits.acceleration ({a:g} rad/s2)"
    yield Bounded(["urdf"], what, needed, high, "Nm", of)


def _bodies(c: Configuration, model: Model, reach: float) -> Iterator[Bounded]:
    links, mass = model.links, sum(link.mass for link in model.links)
    places = [f"urdf ({c.urdf}), line {link.line}: link {link.name!r}" for link in links]
    for link, where in zip(links, places, strict=True):
        why = f"its mass of {link.mass:g} kg at half the reach of the whole arm ({reach:.3g} m)"
        yield Bounded(["urdf"], where, link.moment, link.mass * (0.5 * reach) ** 2, "kg m2", why)
    if sum(link.mass > 0.0 for link in links) > 2:
        why = f"{HEAVIEST:g} times all other moving links together: is it in kg?"
        for link, where in zip(links, places, strict=True):
            yield Bounded(["urdf"], where, link.mass, HEAVIEST * (mass - link.mass), "kg", why)


def _weightless(c: Configuration, model: Model) -> Iterator[Problem]:
    """Joints whose own body has no mass or inertia; frames attached to it may have none."""
    for name in c.joint_names:
        body = [link for link in model.links if link.joint == name]
        mass = sum(link.mass for link in body)
        if mass > 0 and any(link.moment > 0 for link in body):
            continue
        what = "no inertia about its centre of mass" if mass > 0 else "no mass"
        yield Problem(
            ["urdf"],
            f"urdf ({c.urdf}), line {body[0].line}",
            f"link {body[0].name!r}, which joint {name} moves, has {what}: it needs an <inertial> "
            "with mass, in kg, and inertia above 0; otherwise its weight is detected as a contact",
        )


def _of(motor: float) -> str:
    return f"the motor's {motor:.4g} Nm (torque_constant times max_current_A)"
