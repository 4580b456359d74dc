"""Identity of a drive, and checks that it is the configured one and can be used."""

from dataclasses import dataclass
from typing import Final

from common.errors import DriveError
from drivers.canopen.boot.data_sheet import makers_numbers
from drivers.canopen.boot.required_objects import (
    CYCLIC_SYNCHRONOUS_VELOCITY,
    DriveSetup,
    rated_object,
)
from drivers.canopen.boot.sdo import ObjectAccess

_CIA_402: Final = 402
# Relative tolerance of the rated value, which scales every current or torque that a drive reports.
_RATED_TOLERANCE: Final = 0.005


@dataclass(frozen=True, slots=True)
class DriveIdentity:
    """Identity of one drive from objects 0x1018 and 0x1008; None for missing entries."""

    name: str
    node: int
    vendor: int
    product: int | None
    revision: int | None
    serial: int | None
    device: str | None = None

    def __str__(self) -> str:
        numbers = (("vendor", self.vendor), ("product", self.product), ("revision", self.revision))
        known = [f"{what} 0x{value:X}" for what, value in numbers if value is not None]
        device = [self.device] if self.device else []
        serial = "no serial number" if self.serial is None else f"serial {self.serial}"
        return ", ".join([*device, *known, serial])


def identify(setup: DriveSetup, access: ObjectAccess) -> DriveIdentity:
    """Read the identity of a drive. Raises DriveError if it is no CiA 402 drive, not the product of
    the EDS or not the configured drive, or lacks the rating or cyclic synchronous velocity mode."""
    device_profile = access.read(0x1000) & 0xFFFF
    if device_profile != _CIA_402:
        raise DriveError(
            f"{setup} is not a CiA 402 drive: object 0x1000:00 reads device profile "
            f"{device_profile}, expected {_CIA_402}"
        )
    vendor = access.read(0x1018, 1)
    product, revision, serial = (
        access.read(0x1018, sub) if access.has(0x1018, sub) else None for sub in (2, 3, 4)
    )
    drive = setup.drive
    _refuse_other_product(setup, vendor, product)
    if drive.wiring.serial is not None and serial != drive.wiring.serial:
        raise DriveError(
            f"{setup} is another drive: object 0x1018:04 reads serial number {serial}, configured "
            f"{drive.wiring.serial}"
        )
    device = access.read_text(0x1008) if access.has(0x1008) else None
    modes = access.read(0x6502) if access.has(0x6502) else -1
    if not modes >> (CYCLIC_SYNCHRONOUS_VELOCITY - 1) & 1:
        raise DriveError(
            f"{setup} has no cyclic synchronous velocity mode: object 0x6502:00 reads "
            f"0x{modes:08X}, bit 8 is required"
        )
    _refuse_other_rating(setup, access)
    return DriveIdentity(drive.name, drive.node, vendor, product, revision, serial, device)


def _refuse_other_product(setup: DriveSetup, vendor: int, product: int | None) -> None:
    """Refuse a drive that is not the product of the EDS, which may not apply to it."""
    profile = setup.drive.profile
    if profile.any_product:
        return
    numbers = makers_numbers(setup.data_sheet)
    for name, subindex, found in (("VendorNumber", 1, vendor), ("ProductNumber", 2, product)):
        expected = numbers.get(name)
        if expected is not None and found is not None and found != expected:
            raise DriveError(
                f"{setup} is another product than that of {profile.eds}: object 0x1018:"
                f"{subindex:02X} reads 0x{found:X}, but {name} is 0x{expected:X}; set "
                f"drives.{setup.drive.wiring.profile}.eds to the EDS of this drive, or "
                f"drives.{setup.drive.wiring.profile}.any_product to true"
            )


def _refuse_other_rating(setup: DriveSetup, access: ObjectAccess) -> None:
    profile, wiring = setup.drive.profile, setup.drive.wiring
    index, what = rated_object(profile), profile.effort
    in_current = what == "current"
    configured = wiring.rated_current_A if in_current else wiring.rated_torque_Nm
    unit = "A" if in_current else "Nm"
    if configured is None or not access.has(index):
        return
    rated = access.read(index) / 1000.0
    if abs(rated - configured) > _RATED_TOLERANCE * configured:
        raise DriveError(
            f"{setup}: object 0x{index:04X}:00 reads a rated {what} of {rated:g} {unit}, "
            f"configured {configured:g} {unit}"
        )
