"""Draft of a drive profile from its EDS: objects with their scales and reasons, a PDO mapping, and
a verdict on whether contactd can use the drive.

The comment `# CHECK` of a line asks for what an EDS does not contain and only the manual says.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from common.errors import ConfigurationError
from common.yaml_source import quoted
from daemon.config.drive_mistakes import CYCLIC_VELOCITY
from daemon.config.problem import figure
from drivers.canopen.boot.data_sheet import DataSheet, find_object, value_range
from drivers.canopen.boot.mandatory_objects import FOLLOWS
from programs.contactd.drafts.choice import (
    MOST_SHOWN,
    NO_LINK_ENCODER,
    Candidate,
    Choice,
    Object,
    choose,
    looked_at,
)
from programs.contactd.drafts.motor import Load, Motor
from programs.contactd.drafts.pdos import Layout, pdo_layout
from programs.contactd.drafts.scales import GEAR, Scale, scale_of

ORDER = ("effort", "link_position", "motor_velocity", "motor_position", "target_velocity",
         "quick_stop_deceleration", "max_motor_speed")  # fmt: skip
OPTIONAL = ("motor_position", "max_motor_speed")
_LIMITS = (0x6072, 0x6073)
SHAFT_CONSTANT = 0.04  # torque constant of a typical motor at its shaft [Nm/A]
PEAK = 1.8  # peak current over rated current


@dataclass(frozen=True, slots=True)
class Drafted:
    """One quantity: its object, the other candidates, and its scale."""

    name: str
    object: Candidate
    others: tuple[Candidate, ...]
    scale: Scale

    @property
    def asked(self) -> bool:
        """True if the choice of the object itself is a guess."""
        return bool(self.object.doubt)

    def line(self) -> str:
        """Line of `config.yaml`, with reasons and other candidates."""
        where = self.object
        sub = f", subindex: {where.subindex}" if where.subindex else ""
        check = "" if self.scale.sure and not self.asked else "CHECK: "
        others = ", ".join(map(str, self.others[:MOST_SHOWN]))
        reasons = [where.doubt, self.scale.reason, f"not taken: {others}" if others else ""]
        return (
            f"    {self.name}: {{object: 0x{where.index:04X}{sub}, type: {where.type}, "
            f"scale: {self.scale.value!r}}}   # {check}{'; '.join(filter(None, reasons))}"
        )


@dataclass(frozen=True, slots=True)
class DraftedDrive:
    """Drafted profile: file name of its EDS, quantities and PDOs, peak torque over rated torque
    (None: not in the EDS), and conditions for its use."""

    eds: str
    quantities: dict[str, Drafted]
    layout: Layout
    peak: float | None
    settings: list[str] = field(default_factory=list)

    @property
    def link_encoder(self) -> bool:
        """True unless the motor encoder substitutes for a link encoder."""
        return self.quantities["link_position"].object.doubt != NO_LINK_ENCODER

    @property
    def sends_motor_position(self) -> bool:
        """True if a TPDO carries the motor position."""
        return "motor_position" in self.quantities

    def verdict(self, loads: Sequence[Load] = ()) -> str:
        """Words on whether, and under which conditions, contactd can use the drive."""
        return "can be used" + (f" {'; '.join(self.settings)}" if self.settings else "")

    def motor(self, load: Load) -> Motor:
        """Guess of a typical motor that can carry a joint."""
        constant = SHAFT_CONSTANT * GEAR * 0.8
        peak = min(PEAK, self.peak or PEAK)
        rated = float(figure(load.torque / constant / peak))
        # Typical of such a motor; with a much lighter rotor no velocity loop is stable in the gap.
        usual = 3e-4 * (constant * rated / GEAR) ** (5.0 / 3.0) * GEAR**2
        return Motor(
            gear=GEAR, rated_A=rated, max_A=peak * rated, constant=constant,
            rotor=max(usual, 0.15 * load.inertia), torque=load.torque,
            friction=(0.03 * load.torque, 0.02 * load.torque), end="brake",
        )  # fmt: skip

    def text(self, name: str, loads: Sequence[Load] = ()) -> str:
        """Entry of `config.yaml` under `drives`."""
        why = "as the EDS fixes them" if self.layout.fixed else "laid out by contactd"
        pdos = [
            f"    {kind}:   # {why}\n"
            + "\n".join(f'      "{n}": [{", ".join(entries)}]' for n, entries in layout.items())
            for kind, layout in (("tpdo", self.layout.tpdo), ("rpdo", self.layout.rpdo))
        ]
        lines = [f"  {quoted(name)}:", f"    eds: {quoted(self.eds)}"]
        lines += [quantity.line() for quantity in self.quantities.values()]
        return "\n".join([*lines, *pdos]) + "\n"


def drafted_drive(
    sheet: DataSheet, eds: str, by_hand: Mapping[str, Object] | None = None
) -> DraftedDrive:
    """Drafted profile from an EDS. by_hand: objects that the user gives, by quantity. Raises
    ConfigurationError that lists every reason why contactd cannot use the drive."""
    named = by_hand or {}
    try:
        choices = choices_of(sheet, named)
    except ConfigurationError as error:
        raise ConfigurationError(f"{eds}: {error}") from error
    reasons = [*_obstacles(sheet), *_unfound(sheet, choices)]
    objects = {name: choice.chosen for name, choice in choices.items() if choice.chosen}
    try:
        layout = pdo_layout(sheet, objects) if not reasons else Layout({}, {}, fixed=False)
    except ConfigurationError as error:
        reasons.append(f"there is {error}")
    if reasons:
        among = reasons[0] if len(reasons) == 1 else "".join(f"\n  {why}" for why in reasons)
        raise ConfigurationError(f"{eds}: cannot be used, because {among}".replace(" \n", "\n"))
    sent = {entry for entries in layout.tpdo.values() for entry in entries}
    quantities = {
        name: Drafted(name, one, choices[name].others, scale_of(sheet, name, one))
        for name, one in objects.items()
        if name != "motor_position" or name in sent
    }
    settings = list(_settings(sheet, quantities))
    return DraftedDrive(Path(eds).name, quantities, layout, _peak(sheet), settings)


def choices_of(sheet: DataSheet, named: Mapping[str, Object]) -> dict[str, Choice]:
    """Choices for all quantities, each object used once. Of current and torque only the more
    certain one is chosen; the other can appear among its candidates."""
    found: dict[str, Choice] = {}
    taken: set[Object] = set(named.values())
    for name in ORDER:
        quantity = _effort(sheet, named) if name == "effort" else name
        choice = choose(sheet, quantity, frozenset(taken), named.get(quantity))
        link = found.get("link_position")
        if name == "motor_position" and quantity not in named and link and link.chosen:
            choice = _beside(choice, link.chosen)
        if quantity == "current" and choice.chosen and choice.chosen.index < 0x6000:
            torque = choose(sheet, "torque").chosen
            choice = replace(choice, others=(*choice.others, *([torque] if torque else [])))
        found[quantity] = choice
        taken |= {choice.chosen.where} if choice.chosen else set()
    return found


def _effort(sheet: DataSheet, named: Mapping[str, Object]) -> str:
    if "torque" in named:
        return "torque"
    if "current" in named or choose(sheet, "current").chosen is not None:
        return "current"
    return "torque" if choose(sheet, "torque").chosen is not None else "current"


def _beside(choice: Choice, link: Candidate) -> Choice:
    """Choice of the motor position, given the link position. None if both come from one encoder, as
    0x6063 and 0x6064 do unless a name says otherwise; as doubtful as the link position."""
    one = choice.chosen
    if one is None or link.doubt == NO_LINK_ENCODER:
        return Choice(None)
    if link.index == 0x6064 and one.index == 0x6063 and "motor" not in one.name.lower():
        return Choice(None)
    if not link.doubt or one.index not in (0x6063, 0x6064):
        return choice
    return replace(choice, chosen=replace(one, doubt=link.doubt))


def _obstacles(sheet: DataSheet) -> Iterator[str]:
    """Features that contactd requires of every drive and that this EDS lacks."""
    for (index, subindex), what in FOLLOWS.items():
        if find_object(sheet, index, subindex) is None:
            yield f"without 0x{index:04X}:{subindex:02X} {what}"
    modes = find_object(sheet, 0x6502)
    if modes is not None and isinstance(modes.default, int) and not modes.default & CYCLIC_VELOCITY:
        yield (
            f"its modes, 0x{modes.default:08X} in 0x6502, lack mode 9, cyclic synchronous velocity "
            "(bit 8): where your firmware has it, correct 0x6502 in your copy of the EDS"
        )


def _unfound(sheet: DataSheet, choices: Mapping[str, Choice]) -> Iterator[str]:
    for name, choice in choices.items():
        if choice.chosen is None and name not in OPTIONAL:
            effort = name in ("current", "torque")
            quantities = ("current", "torque") if effort else (name,)
            yield (
                f"no object in its EDS is certain to be its {' or '.join(quantities)}: "
                f"{looked_at(sheet, quantities)}; name it by --object {name}=0xINDEX:SUB, if its "
                "manual has one"
            )


def _settings(sheet: DataSheet, quantities: Mapping[str, Drafted]) -> Iterator[str]:
    """Conditions under which the drive can be used."""
    modes = find_object(sheet, 0x6502)
    if modes is None or not isinstance(modes.default, int):
        yield "if its manual has mode 9 (cyclic synchronous velocity), as 0x6502 has no value here"
    if quantities["link_position"].object.doubt == NO_LINK_ENCODER:
        yield (
            "with half_gap 0, as no object is a link encoder (--object link_position=0x6064, if "
            "that is one)"
        )
    doubtful = [name for name, one in quantities.items() if one.asked]
    if doubtful:
        yield f"once you have checked {' and '.join(doubtful)} by turning the motor (CHECK)"


def _peak(sheet: DataSheet) -> float | None:
    """Largest torque limit that the EDS allows, over the rated torque; None if it states none."""
    limits = [
        value_range(variable)[1]
        for variable in (find_object(sheet, index) for index in _LIMITS)
        if variable is not None and variable.max is not None
    ]
    return min(limits) / 1000.0 if limits else None
