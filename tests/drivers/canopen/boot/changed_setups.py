"""Set-ups of drives with other settings than those of the arm's configuration."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import msgspec

from drivers.canopen.boot.required_objects import DriveSetup


def with_wiring(setup: DriveSetup, **changes: Any) -> DriveSetup:
    """The set-up of a drive with another wiring."""
    wiring = msgspec.structs.replace(setup.drive.wiring, **changes)
    return replace(setup, drive=replace(setup.drive, wiring=wiring))


def with_profile(setup: DriveSetup, **changes: Any) -> DriveSetup:
    """The set-up of a drive with other values in its profile, which are checked."""
    raw = msgspec.to_builtins(setup.drive.profile) | changes
    profile = msgspec.convert(raw, type(setup.drive.profile))
    return replace(setup, drive=replace(setup.drive, profile=profile))


def third(setups: Sequence[DriveSetup], setup: DriveSetup | None = None) -> list[DriveSetup]:
    """All set-ups, with another third; by default one with a short timeout, for a drive that is to
    time out."""
    changed = setup or with_profile(setups[2], sdo_timeout_ms=100)
    return [*setups[:2], changed, *setups[3:]]
