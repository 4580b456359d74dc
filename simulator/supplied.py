"""Values required by CiA 301 and CiA 402, supplied if an EDS gives no default: a real drive has its
own, and an EDS need not state them."""

from collections.abc import Iterator
from dataclasses import replace

from common.eds import INTEGER_BITS, Eds, EdsObject

DEVICE_TYPE = 0x00020192
"""Device type of a servo drive, device profile 402."""
CYCLIC_VELOCITY = 1 << 8
"""Bit of cyclic synchronous velocity in 0x6502."""
_SYNC, _EMERGENCY = 0x80, 0x80
_BY_EVENT = 255
_PDO_ID = {0x1400: 0x200, 0x1800: 0x180}
"""COB-IDs of the first PDOs (CiA 301), without the node ID."""
_PDOS = 4  # number of PDOs with predefined COB-IDs in CiA 301
_UNSIGNED8, _TEXT = 0x05, 0x09
_PACKED = frozenset(code for code, bits in INTEGER_BITS.items() if abs(bits) in (8, 16, 32))


def supplied(eds: Eds) -> dict[tuple[int, int], EdsObject]:
    """Objects whose value the EDS lacks, with a supplied value, by index and subindex."""
    found = {(one.index, one.subindex): one for one in _values(eds)}
    with_values = {**eds.objects, **found}
    found |= {(one.index, one.subindex): one for one in _mappings(with_values)}
    return found


def in_words(eds: Eds) -> list[str]:
    """One line for each supplied object, except PDO parameters."""
    lines = []
    for (index, subindex), one in sorted(supplied(eds).items()):
        shown = f"0x{one.default:X}" if isinstance(one.default, int) else f"{one.default!r}"
        if not 0x1400 <= index < 0x1C00:
            lines.append(f"0x{index:04X}:{subindex:02X} ({one.name}) = {shown}")
    return lines


def _values(eds: Eds) -> Iterator[EdsObject]:
    """Identity, modes and COB-IDs. Missing objects are not added, except the error register, which
    every device has."""
    if (0x1001, 0) not in eds.objects:
        yield EdsObject(0x1001, 0, "Error register", _UNSIGNED8, "ro", False, 0)
    numbers = ("VendorNumber", "ProductNumber", "RevisionNumber")
    wanted: dict[tuple[int, int], int | str] = {
        (0x1000, 0): DEVICE_TYPE,
        (0x1005, 0): _SYNC,
        (0x1008, 0): eds.device.get("productname", "") or "drive",
        (0x6502, 0): CYCLIC_VELOCITY,
        **{(0x1018, sub): eds.number(name) for sub, name in enumerate(numbers, start=1)},
    }
    for place, value in wanted.items():
        one = eds.objects.get(place)
        if one is not None and one.default is None and (one.type == _TEXT) is (
            isinstance(value, str)
        ):  # fmt: skip
            yield replace(one, default=value)
    emergency = eds.objects.get((0x1014, 0))
    if emergency is not None and emergency.default is None:
        yield replace(emergency, default=_EMERGENCY, relative=True)
    for (index, subindex), one in eds.objects.items():
        base = 0x1400 if index < 0x1600 else 0x1800
        if one.default is not None or not base <= index < base + _PDOS:
            continue
        if subindex == 1:
            number = index - base
            yield replace(one, default=_PDO_ID[base] + 0x100 * number, relative=True)
        elif subindex == 2:
            yield replace(one, default=_BY_EVENT)


def _mappings(objects: dict[tuple[int, int], EdsObject]) -> Iterator[EdsObject]:
    """Mappings that begin empty: their objects are not given, or of a type not simulated."""
    for (index, subindex), count in objects.items():
        if subindex or not (0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00):
            continue
        number = count.default if isinstance(count.default, int) else -1
        mapped = [objects.get((index, sub)) for sub in range(1, number + 1)]
        places = [
            one.default if one is not None and isinstance(one.default, int) else 0 for one in mapped
        ]
        found = [objects.get((place >> 16, place >> 8 & 0xFF)) for place in places]
        if number < 0 or not all(one is not None and one.type in _PACKED for one in found):
            yield replace(count, default=0)
