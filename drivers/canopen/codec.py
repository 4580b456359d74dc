"""PDO codec of the whole arm: `struct` layouts, and conversion of counts to SI at the link side.

A quantity of a drive is value = sign * (offset + scale * counts), in the drive's unit (rad or rad/s
of the motor shaft, fraction of the rated current). At the link side:

    current        [A]      motor_sign * rated_current_A * value  (torque likewise)
    motor_velocity [rad/s]  motor_sign * value / gear             (motor_position [rad] likewise)
    link_position  [rad]    link_sign * value + link_offset - `link_correction`

and a target velocity is converted by the inverse. All but the correction is affine: the whole arm
takes one multiplication and one addition. COB-IDs are those of `drivers.canopen.ids`.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.arrays import Vector, check_shapes
from common.errors import ConfigurationError
from drivers.canopen.ids import NEXT_PDO, RPDO, TPDO
from drivers.canopen.settings import CanopenDrive, CanopenProfile, PdoEntry, PdoLayout, Quantity
from drivers.counts import correct, decode, encode
from drivers.drive import harmonics

STRUCT_CODES: Final = {
    "INTEGER8": "b",
    "INTEGER16": "h",
    "INTEGER32": "i",
    "UNSIGNED8": "B",
    "UNSIGNED16": "H",
    "UNSIGNED32": "I",
}
WORDS: Final = {"statusword": 0x6041, "controlword": 0x6040}
MEASURED: Final[tuple[PdoEntry, ...]] = (
    "current",
    "link_position",
    "motor_velocity",
    "motor_position",
)


class LayoutError(ConfigurationError):
    """Invalid PDO layout; `at` is its location in the profile."""

    def __init__(self, text: str, *at: str) -> None:
        super().__init__(text)
        self.at = at


def type_limits(type_name: str) -> tuple[int, int]:
    """Lowest and highest value of an integer type of CiA 301."""
    code = STRUCT_CODES[type_name]
    bits = 8 * struct.calcsize(code)
    return (-1 << (bits - 1), (1 << (bits - 1)) - 1) if code.islower() else (0, (1 << bits) - 1)


@dataclass(frozen=True, slots=True)
class PdoField:
    """Mapped object: its entry in the profile, and its address and type in the drive."""

    entry: PdoEntry
    index: int
    subindex: int
    type: str

    @property
    def bits(self) -> int:
        return 8 * struct.calcsize(STRUCT_CODES[self.type])


@dataclass(frozen=True, slots=True)
class Pdo:
    """One PDO of one drive; `layout` packs its fields in the order of the mapping."""

    number: int
    cob_id: int
    fields: tuple[PdoField, ...]
    layout: struct.Struct


def quantity(profile: CanopenProfile, entry: PdoEntry) -> Quantity:
    """Object of the profile that holds `entry`. Raises ConfigurationError if it defines none."""
    found = getattr(profile, entry)
    if not isinstance(found, Quantity):
        raise ConfigurationError(f"{entry} is not defined")
    return found


def _field(profile: CanopenProfile, entry: PdoEntry, *at: str) -> PdoField:
    if entry in WORDS:
        return PdoField(entry, WORDS[entry], 0, "UNSIGNED16")
    if getattr(profile, entry) is None:
        text = f"the PDO lists `{entry}`, but the drive profile does not define it"
        raise LayoutError(text, *at)
    where = quantity(profile, entry)
    return PdoField(entry, where.object, where.subindex, where.type)


def _pdos(drive: CanopenDrive, kind: str, layouts: PdoLayout, base: int) -> tuple[Pdo, ...]:
    pdos = []
    for number, entries in sorted(layouts.items()):
        fields = tuple(_field(drive.profile, entry, kind, number) for entry in entries)
        layout = struct.Struct("<" + "".join(STRUCT_CODES[field.type] for field in fields))
        if layout.size > 8:
            raise LayoutError(
                f"PDO {number} [{', '.join(entries)}] has {layout.size} bytes; 8 are allowed",
                *(kind, number),
            )
        cob_id = base + NEXT_PDO * (int(number) - 1) + drive.node
        pdos.append(Pdo(int(number), cob_id, fields, layout))
    return tuple(pdos)


def _refuse_entries(pdos: Sequence[Pdo], kind: str, required: set[str], allowed: set[str]) -> None:
    carried: list[str] = []
    for pdo in pdos:
        for field in pdo.fields:
            at, entry = (kind, str(pdo.number)), field.entry
            if entry not in allowed:
                raise LayoutError(
                    f"{kind}: {entry} is not allowed; use {', '.join(sorted(allowed))}", *at
                )
            if entry in carried:
                raise LayoutError(f"{kind}: {entry} is mapped more than once", *at)
            carried.append(entry)
    missing = sorted(required.difference(carried))
    if missing:
        raise LayoutError(f"{kind}: {', '.join(missing)} missing", kind)


def transmit_pdos(drive: CanopenDrive) -> tuple[Pdo, ...]:
    """PDOs that a drive sends. Raises LayoutError if an entry is missing, duplicate or too long."""
    pdos = _pdos(drive, "tpdo", drive.profile.tpdo, TPDO)
    required = {"statusword", drive.profile.effort, "link_position", "motor_velocity"}
    _refuse_entries(pdos, "tpdo", required, required | {"motor_position"})
    return pdos


def receive_pdos(drive: CanopenDrive) -> tuple[Pdo, ...]:
    """PDOs that a drive receives. Raises LayoutError as `transmit_pdos`."""
    pdos = _pdos(drive, "rpdo", drive.profile.rpdo, RPDO)
    entries = {"controlword", "target_velocity"}
    _refuse_entries(pdos, "rpdo", entries, entries)
    return pdos


def link_side(drive: CanopenDrive, entry: PdoEntry) -> tuple[float, float]:
    """(gain, bias) such that the SI value at the link is gain * counts + bias.

    Torque is treated as current: both are fractions of the rated value.
    """
    where, wiring = quantity(drive.profile, entry), drive.wiring
    if entry in ("current", "torque"):
        factor, bias = wiring.motor_sign * wiring.rated_current_A, 0.0
    elif entry == "link_position":
        factor, bias = float(wiring.link_sign), wiring.link_offset
    else:
        factor, bias = wiring.motor_sign / wiring.gear, 0.0
    factor *= where.sign
    return factor * where.scale, factor * where.offset + bias


class SampleDecoder:
    """Decoder of the arm's TPDOs into arrays of shape (n,), new and read-only after each `decode`.

    Values are NaN, and statuswords -1, until the first frame with them arrives. `motor_position` is
    None unless every drive sends one.
    """

    def __init__(self, drives: Sequence[CanopenDrive]) -> None:
        n = len(drives)
        self.statuswords = (-1,) * n
        # Raw counts of all frames, concatenated, as unpacked by `struct`.
        self.raw: list[float] = []
        #: COB-ID -> (joint, first slot, last slot + 1, layout)
        self.slots: dict[int, tuple[int, int, int, struct.Struct]] = {}
        place: dict[tuple[str, int], int] = {}
        for i, drive in enumerate(drives):
            for pdo in transmit_pdos(drive):
                start = len(self.raw)
                for field in pdo.fields:
                    row = "current" if field.entry == "torque" else field.entry
                    place[row, i] = len(self.raw)
                    self.raw.append(-1 if field.entry == "statusword" else np.nan)
                self.slots[pdo.cob_id] = (i, start, len(self.raw), pdo.layout)
        entries = [e for e in MEASURED if all((e, i) in place for i in range(n))]
        self._status_slots = [place["statusword", i] for i in range(n)]
        self._order = np.array([[place[e, i] for i in range(n)] for e in entries])
        affine = np.array(
            [
                [link_side(d, d.profile.effort if e == "current" else e) for d in drives]
                for e in entries
            ]
        )
        self._gain, self._bias = affine[..., 0].copy(), affine[..., 1].copy()
        row_of = {entry: number for number, entry in enumerate(entries)}
        self._rows = row_of["current"], row_of["link_position"], row_of["motor_velocity"]
        self._motor_row = row_of.get("motor_position")
        self._offset = np.array([drive.wiring.link_offset for drive in drives])
        self._harmonics = harmonics(drives)
        self.motor_position: Vector | None = None
        self.decode()

    def decode(self) -> None:
        """Update the arrays and the statuswords from the counts in `raw`."""
        values = np.empty(self._gain.shape)
        decode(self.raw, self._order, self._gain, self._bias, values)
        current, link_position, motor_velocity = self._rows
        correct(values[link_position], self._offset, self._harmonics)
        values.setflags(write=False)  # its rows inherit this
        self.current: Vector = values[current]
        self.link_position: Vector = values[link_position]
        self.motor_velocity: Vector = values[motor_velocity]
        if self._motor_row is not None:
            self.motor_position = values[self._motor_row]
        raw = self.raw
        self.statuswords = tuple([int(raw[slot]) for slot in self._status_slots])


class SetpointEncoder:
    """Encoder of the arm's target velocities [rad/s at the link] into counts."""

    def __init__(self, drives: Sequence[CanopenDrive]) -> None:
        affine = np.array([link_side(drive, "target_velocity") for drive in drives])
        self._gain, self._bias = affine[:, 0].copy(), affine[:, 1].copy()
        limits = [type_limits(drive.profile.target_velocity.type) for drive in drives]
        self._lowest = np.array([float(lowest) for lowest, _ in limits])
        self._highest = np.array([float(highest) for _, highest in limits])
        self._counts = np.zeros(len(drives))
        #: Counts of zero velocity.
        self.standstill = self.encode(np.zeros(len(drives)))

    def encode(self, velocity: Vector) -> list[int]:
        """Counts, rounded to the nearest (ties to even) and saturated at the object's limits.

        Raises ValueError if a velocity is not finite: saturated, it would command full speed.
        """
        check_shapes(self._gain.shape, velocity=velocity)
        if not encode(velocity, self._gain, self._bias, self._lowest, self._highest, self._counts):
            raise ValueError(f"target velocity is not finite: {velocity}")
        return [int(count) for count in self._counts.tolist()]
