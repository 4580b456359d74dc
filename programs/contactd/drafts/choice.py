"""Choice of a drive's object for each quantity, by index, name, access type and PDO mappability
alone. A writable parameter is never chosen as a measurement."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from common.errors import ConfigurationError
from daemon.config.drive_mistakes import AVERAGED, NO_MEASUREMENT, words_of
from drivers.canopen.boot.data_sheet import DataSheet, Variable, find_object, type_name
from drivers.canopen.codec import STRUCT_CODES

Object = tuple[int, int]
Words = frozenset[str]

NO_LINK_ENCODER = (
    "no object here is a link encoder. 0x6064 is assumed to be the motor's, divided by the gear: "
    "backlash and compliance of the gear are not seen, half_gap is 0 (docs/identification.md)"
)
_SET_UP = "which sensor it is depends on the drive's set-up: turn the motor by hand and read all"
_MAKERS_OWN = range(0x2000, 0x6000)
_POSITIONS = (0x6063, 0x6064, 0x60E4)
_SECOND_SENSORS: tuple[Object, ...] = ((0x60E4, 1), (0x60E4, 2), (0x60E4, 3))
MOST_SHOWN = 4


def _any(words: str) -> Words:
    return frozenset(words.split())


_MEASURED = _any("actual measured measurement feedback")
_PLACE = _any("position encoder angle")
_LINK = _any("link load output joint")
_SECOND = _any("auxiliary auxilary aux second secondary external additional")
_NO_MEASUREMENT = NO_MEASUREMENT | _any(
    "gain kp ki window offset error following mode homing home config configuration time timeout "
    "filter difference resolution factor index "
    "status function settings captured capture edge probe number type bias test correction range"
)
"""Words that mark an object's name as a setpoint, limit or parameter rather than a measurement."""


@dataclass(frozen=True, slots=True)
class Rule:
    """Rule that matches objects of CiA 402, or manufacturer-specific objects whose names contain a
    word of each set. doubt: open question about a match, which the drive's manual has to answer."""

    objects: tuple[Object, ...] = ()
    words: tuple[Words, ...] = ()
    doubt: str = ""


RULES: Mapping[str, tuple[Rule, ...]] = {
    "current": (Rule(((0x6078, 0),)), Rule(words=(_any("current currents"), _MEASURED))),
    "torque": (Rule(((0x6077, 0),)), Rule(words=(_any("torque"), _MEASURED))),
    "link_position": (
        Rule(words=(_LINK, _PLACE)),
        Rule(_SECOND_SENSORS, doubt=_SET_UP),
        Rule(words=(_SECOND, _PLACE), doubt=_SET_UP),
        Rule(((0x6064, 0),), doubt=NO_LINK_ENCODER),
    ),
    "motor_velocity": (
        Rule(((0x606C, 0), (0x6069, 0))),
        Rule(words=(_any("velocity speed"), _MEASURED | {"motor"})),
    ),
    "motor_position": (Rule(words=(_any("motor"), _PLACE)), Rule(((0x6064, 0), (0x6063, 0)))),
    "target_velocity": (Rule(((0x60FF, 0),)),),
    "quick_stop_deceleration": (Rule(((0x6085, 0),)),),
    "max_motor_speed": (Rule(((0x6080, 0), (0x607F, 0))),),
}
"""Rules for each quantity, the most certain first."""
MEASURED = ("current", "torque", "motor_velocity", "link_position", "motor_position")
_MAPPED = (*MEASURED, "target_velocity")


@dataclass(frozen=True, slots=True)
class Candidate:
    """Candidate object for a quantity."""

    index: int
    subindex: int
    type: str
    name: str
    doubt: str = ""

    @property
    def where(self) -> Object:
        """Index and subindex."""
        return self.index, self.subindex

    def __str__(self) -> str:
        name = "".join(c if c.isprintable() and c != "'" else " " for c in self.name)
        return f"0x{self.index:04X}:{self.subindex:02X} '{name}'"


@dataclass(frozen=True, slots=True)
class Choice:
    """Chosen object of a quantity, other candidates, and similar objects that were ruled out."""

    chosen: Candidate | None
    others: tuple[Candidate, ...] = ()
    passed_over: tuple[str, ...] = ()


def choose(
    sheet: DataSheet, quantity: str, taken: frozenset[Object] = frozenset(),
    named: Object | None = None,
) -> Choice:  # fmt: skip
    """Choice for a quantity among objects that are not taken yet. named: the object that the user
    gives instead. Raises ConfigurationError if that object is missing or unfit."""
    if named is not None:
        return Choice(_by_hand(sheet, quantity, named))
    found: dict[Object, Candidate] = {}
    passed_over: dict[Object, str] = {}
    for rule in RULES[quantity]:
        for variable in _of_rule(sheet, rule):
            one = _found(variable, rule.doubt)
            if one.where in taken or one.where in found:
                continue
            if why := _unfit(variable, quantity):
                passed_over[one.where] = f"{one} {why}"
            else:
                found[one.where] = one
    for variable in _alike(sheet, quantity):
        one = _found(variable)
        if one.where not in (*found, *taken):
            why = _unfit(variable, quantity) or "is not a measurement by its name"
            passed_over.setdefault(one.where, f"{one} {why}")
    chosen = next(iter(found.values()), None)
    others = tuple(found.values())[1:]
    if chosen is not None and chosen.doubt == NO_LINK_ENCODER and _of_motor(sheet):
        chosen = replace(chosen, doubt=_SET_UP)
    return Choice(chosen, others, tuple(passed_over.values()))


def looked_at(sheet: DataSheet, quantities: tuple[str, ...]) -> str:
    """Objects that were considered for quantities that were not found, with reasons."""
    standard = (place for q in quantities for rule in RULES[q] for place in rule.objects)
    missing = [
        f"0x{place[0]:04X}:{place[1]:02X} is missing"
        for place in dict.fromkeys(standard)
        if find_object(sheet, *place) is None
    ]
    there = [why for q in quantities for why in choose(sheet, q).passed_over]
    shown = there[:MOST_SHOWN]
    rest = [f"and {len(there) - len(shown)} more"] if len(there) > len(shown) else []
    return ", ".join([*missing, *shown, *rest])


def _of_rule(sheet: DataSheet, rule: Rule) -> Iterator[Variable]:
    for place in rule.objects:
        if (variable := find_object(sheet, *place)) is not None:
            yield variable
    if rule.words:
        # The sort is stable and puts averaged (delayed) values last.
        for variable in sorted(_own(sheet), key=lambda one: bool(words_of(one.name) & AVERAGED)):
            words = words_of(variable.name)
            if all(words & group for group in rule.words) and not words & _NO_MEASUREMENT:
                yield variable


def _of_motor(sheet: DataSheet) -> bool:
    """True if another object is by name the motor position, so that 0x6064 may be the link's."""
    (rule, *_) = RULES["motor_position"]
    return any(not _unfit(variable, "motor_position") for variable in _of_rule(sheet, rule))


def _own(sheet: DataSheet) -> Iterator[Variable]:
    """Manufacturer-specific variables, and position objects of CiA 402, whose names may say which
    sensor they read."""
    for index in sheet:
        if index in _MAKERS_OWN or index in _POSITIONS:
            members = getattr(sheet[index], "subindices", None)
            yield from [sheet[index]] if members is None else (
                variable for sub, variable in members.items() if sub
            )  # fmt: skip


def _alike(sheet: DataSheet, quantity: str) -> Iterator[Variable]:
    """Manufacturer-specific variables whose names contain the word of a measured quantity."""
    first = {"current": "current", "torque": "torque", "motor_velocity": "velocity",
             "link_position": "position", "motor_position": "position"}  # fmt: skip
    for variable in _own(sheet):
        if variable.index in _MAKERS_OWN and first.get(quantity) in words_of(variable.name):
            yield variable


def _found(variable: Variable, doubt: str = "") -> Candidate:
    kind = type_name(variable)
    return Candidate(variable.index, variable.subindex, kind, variable.name, doubt)


def _unfit(variable: Variable, quantity: str) -> str:
    """Reason why an object cannot be used for a quantity; empty if it can."""
    if type_name(variable) not in STRUCT_CODES:
        return "is not an integer of 8, 16 or 32 bits"
    if quantity in MEASURED and variable.writable:
        return f"can be written (access {variable.access_type}): a parameter, not a measurement"
    if quantity not in MEASURED and not variable.writable:
        return f"cannot be written (access {variable.access_type})"
    if quantity in _MAPPED and not variable.pdo_mappable:
        return "cannot be mapped to a PDO"
    return ""


def _by_hand(sheet: DataSheet, quantity: str, named: Object) -> Candidate:
    where = f"--object {quantity}=0x{named[0]:04X}:{named[1]:02X}"
    variable = find_object(sheet, *named)
    if variable is None:
        raise ConfigurationError(f"{where}: this EDS has no such object")
    if why := _unfit(variable, quantity):
        own = "; only config.yaml may name it" if "a parameter" in why else ""
        raise ConfigurationError(f"{where}: {variable.name!r} {why}{own}")
    return _found(variable)
