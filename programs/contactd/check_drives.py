"""Tables of drive profiles for `contactd check`, by make."""

import itertools
from collections.abc import Iterable
from typing import Any

from rich.console import Console
from rich.padding import Padding
from rich.table import Table

from daemon.config.load import Robot
from daemon.config.schema import Configuration
from daemon.drives import build_setups
from drivers.canopen.boot.required_objects import DriveSetup, lacks
from drivers.canopen.codec import receive_pdos, transmit_pdos
from drivers.canopen.settings import CanopenDrive, CanopenProfile, Quantity
from drivers.log.settings import LogProfile

QUANTITY_UNITS = {
    "current": "of rated",
    "torque": "of rated",
    "link_position": "rad",
    "motor_velocity": "rad/s",
    "motor_position": "rad",
    "target_velocity": "rad/s",
    "quick_stop_deceleration": "rad/s2",
    "max_motor_speed": "rad/s",
}
FORMULA = "value = sign * (offset + scale * counts); link_position at link, else at motor"
# Consequences of optional quantities that a drive profile leaves out.
WITHOUT = {
    "motor_position": "integrated from the velocity",
    "max_motor_speed": "the drive's own speed limit is left as it is",
}
FOLDED = "mapping"  # the column that may wrap
_LABEL = 20  # longest label [characters] with which the widest table fits into 80 columns


def drives_in_words(robot: Robot) -> list[Table | str]:
    """Tables and remarks about each drive profile."""
    c = robot.configuration
    if isinstance(c.joint_drives[0].profile, LogProfile):
        return []
    setups: dict[str, Any] = {
        joint.wiring.profile: setup
        for joint, setup in zip(c.joints, build_setups(robot), strict=True)
    }
    found: list[Table | str] = []
    for name, profile in c.drives.items():
        if isinstance(profile, CanopenProfile):
            found += _canopen(c, name, profile, setups[name])
    motors = _motors(c)
    return found or ([motors] if motors.row_count else [])


def _canopen(
    c: Configuration, name: str, profile: CanopenProfile, setup: DriveSetup
) -> list[Table | str]:
    return [
        _quantities(name, profile),
        FORMULA,
        *(
            f"without {field}: {instead}"
            for field, instead in WITHOUT.items()
            if getattr(profile, field) is None
        ),
        _pdos(setup.drive),
        *lacks(setup, c.period_ms, c.bus.master_node),
    ]


def _motors(c: Configuration) -> Table:
    """Table of the motors' measurement resolutions, one row per profile."""
    table = new_table(
        "\nmotors", *("profile", "model", "joints", "mrad", "mrad/s", "mNm", "Nm per A")
    )
    for name, profile in c.drives.items():
        drives = [drive for drive in c.joint_drives if drive.profile is profile]
        if isinstance(profile, CanopenProfile | LogProfile) or not drives:
            continue
        position, velocity, current = (
            1000.0 * abs(c.make.counts(drives[0], measure).gain)
            for measure in ("link_position", "motor_velocity", "effort")
        )
        table.add_row(
            name, f"{type(profile).__struct_config__.tag} {profile.model}", str(len(drives)),
            f"{position:.2f}", f"{velocity:.2f}", f"{current * profile.Nm_per_A:.2g}",
            f"{profile.Nm_per_A:.4g}",
        )  # fmt: skip
    return table


def add_merged(table: Table, rows: Iterable[tuple[str, ...]]) -> None:
    """Add rows of joints in order; merge consecutive rows with equal cells if the merged label is
    short enough."""
    for cells, alike in itertools.groupby(rows, key=lambda row: row[1:]):
        names = [row[0] for row in alike]
        together = f"{names[0]} to {names[-1]}"
        names = [together] if len(names) > 1 and len(together) <= _LABEL else names
        for name in names:
            table.add_row(name, *cells)


def remark(console: Console, text: str) -> None:
    """Print text indented and wrapped."""
    console.print(Padding(text, (0, 0, 0, 2), expand=False), highlight=False)


def new_table(title: str, *columns: str, gap: int = 2) -> Table:
    """Borderless table whose cells are never truncated."""
    table = Table(
        title=title, title_justify="left", box=None, pad_edge=False, padding=(0, gap, 0, 0)
    )
    for column in columns:
        table.add_column(column, no_wrap=column != FOLDED)
    return table


def _quantities(name: str, profile: CanopenProfile) -> Table:
    table = new_table(
        f"\ndrive profile {name} ({profile.eds})",
        *("quantity", "object", "type", "scale", "sign", "offset", "unit"),
        gap=1,
    )
    for field, unit in QUANTITY_UNITS.items():
        where: Quantity | None = getattr(profile, field)
        if where is not None:
            table.add_row(
                field,
                f"0x{where.object:04X}:{where.subindex:02X}",
                where.type,
                f"{where.scale:.6g}",
                f"{where.sign:+d}",
                f"{where.offset:g}",
                unit,
            )
    return table


def _pdos(drive: CanopenDrive) -> Table:
    table = new_table("", "PDO", "COB-ID", "bytes", FOLDED)
    for kind, pdos in (("TPDO", transmit_pdos(drive)), ("RPDO", receive_pdos(drive))):
        for pdo in pdos:
            mapping = ", ".join(
                f"{field.entry} 0x{field.index:04X}:{field.subindex:02X}/{field.bits}"
                for field in pdo.fields
            )
            cob_id = f"0x{pdo.cob_id - drive.node:03X} + node"
            table.add_row(f"{kind}{pdo.number}", cob_id, str(pdo.layout.size), mapping)
    return table
