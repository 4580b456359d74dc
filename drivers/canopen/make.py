"""CANopen as a make of drives: the interface of `drivers.makes`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from common.errors import ConfigurationError
from drivers.can.load import FrameLoad
from drivers.canopen.boot.data_sheet import load_data_sheet
from drivers.canopen.boot.required_objects import DriveSetup
from drivers.canopen.boot.required_objects import problems as contradictions
from drivers.canopen.codec import (
    LayoutError,
    link_side,
    quantity,
    receive_pdos,
    transmit_pdos,
    type_limits,
)
from drivers.canopen.ids import HEARTBEAT, SYNC
from drivers.canopen.recorded import CanopenTicks
from drivers.canopen.settings import CanopenDrive, CanopenProfile, PdoEntry
from drivers.drive import Counts, Measure, ProfileProblem


def problems(
    profile: CanopenProfile,
    drives: Sequence[CanopenDrive],
    folder: Path,
    period_ms: int,
    master_node: int,
) -> list[ProfileProblem]:
    """Contradictions between the EDS in `folder` and a profile with its drives, each reported once,
    at the field of the profile that causes it."""
    try:
        sheet = load_data_sheet(folder / profile.eds)
    except ConfigurationError as error:
        return [(("eds",), str(error))]
    setups = [DriveSetup(drive, sheet) for drive in drives]
    try:
        found = [p for s in setups for p in contradictions(s, period_ms, master_node)]
    except LayoutError as error:
        return [(error.at, str(error))]
    return [(p.at, f"{profile.eds}: {p.what}") for p in dict.fromkeys(found)]


def wrong(drive: CanopenDrive) -> tuple[ProfileProblem, ...]:
    """Problems of a joint with this drive: none, as all are found in its profile."""
    return ()


_ENTRIES: Final[dict[Measure, PdoEntry]] = {
    "link_position": "link_position",
    "motor_velocity": "motor_velocity",
    "target_velocity": "target_velocity",
}


def counts(drive: CanopenDrive, measure: Measure) -> Counts:
    """Integer scale of a quantity of a drive. Raises ConfigurationError if it defines none."""
    entry = drive.profile.effort if measure == "effort" else _ENTRIES[measure]
    kind = quantity(drive.profile, entry).type
    return Counts((entry, "scale"), f"{kind} counts", *link_side(drive, entry), *type_limits(kind))


def frames(
    drives: Sequence[CanopenDrive], period_s: float, master_node: int = 127
) -> tuple[FrameLoad, ...]:
    """All periodic frames of the arm."""
    tick_hz = 1.0 / period_s
    # The master's heartbeat is sent on a tick, at least three times per shortest master timeout.
    master_timeout_s = min(drive.profile.master_timeout_s for drive in drives)
    beat_s = period_s * max(1, math.floor(master_timeout_s / 3.0 / period_s))
    table = [
        FrameLoad("SYNC", SYNC, 0, tick_hz),
        FrameLoad("heartbeat of the master", HEARTBEAT + master_node, 1, 1.0 / beat_s, False),
    ]
    for drive in drives:
        for kind, pdos in (("TPDO", transmit_pdos(drive)), ("RPDO", receive_pdos(drive))):
            table += [
                FrameLoad(f"{drive.name} {kind}{pdo.number}", pdo.cob_id, pdo.layout.size, tick_hz)
                for pdo in pdos
            ]
        beat_hz = 1000.0 / drive.profile.heartbeat_ms
        table.append(
            FrameLoad(f"{drive.name} heartbeat", HEARTBEAT + drive.node, 1, beat_hz, False)
        )
    return tuple(table)


def recorded(drives: Sequence[CanopenDrive], period_s: float) -> CanopenTicks:
    """Reconstruction of an arm's ticks from its recorded frames."""
    return CanopenTicks(drives, period_s)
