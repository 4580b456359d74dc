"""`contactd check`: what follows from a configuration, before anything is on the bus."""

import sys
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from daemon.assembly import build_setups
from daemon.config.load import load_robot
from daemon.config.schema import Configuration
from daemon.travel import worst_travel
from drivers.bus_load import HIGHEST_LOAD, FrameLoad, bus_load, frame_table
from drivers.codec import receive_pdos, transmit_pdos
from drivers.drive_setup import lacks
from drivers.settings import DriveProfile, Quantity

QUANTITY_UNITS = {
    "current": "of the rated current",
    "torque": "of the rated torque",
    "link_position": "rad at the link",
    "motor_velocity": "rad/s of the motor",
    "motor_position": "rad of the motor",
    "target_velocity": "rad/s of the motor",
    "quick_stop_deceleration": "rad/s2 of the motor",
    "max_motor_speed": "rad/s of the motor",
}
# What is done where a drive profile does not have it.
WITHOUT = {
    "motor_position": "not sent: integrated from the velocity",
    "max_motor_speed": "the drive's own speed limit is left as it is",
}


def print_check(config: Path) -> None:
    """Check and describe. Raises ConfigurationError with everything that is wrong."""
    robot = load_robot(config)
    c = robot.configuration
    # Nothing is folded away for a file or a pipe.
    console = Console() if sys.stdout.isatty() else Console(width=120)
    console.print(f"[bold]{c.name}[/bold]: {len(c.joints)} joints, every {c.period_ms} ms")
    setups = {setup.wiring.profile: setup for setup in build_setups(robot)}
    for name, profile in c.drives.items():
        console.print(_quantities(name, profile))
        console.print("value = sign * (offset + scale * counts)", style="dim", highlight=False)
        console.print(_pdos(profile))
        for lack in lacks(setups[name], c.period_ms, c.bus.master_node):
            console.print(f"  {lack}", highlight=False)
    console.print(_joints(c))
    console.print(_travels(c))
    joints = [(joint.name, joint.wiring) for joint in c.joints]
    frames = frame_table(joints, c.drives, c.period_s, c.bus.master_node)
    console.print(_frames(frames))
    load = bus_load(joints, c.drives, c.period_s, c.bus.bitrate)
    exchange_ms = 1000.0 * sum(f.bits for f in frames if f.every_tick) / c.bus.bitrate
    console.print(
        f"bus load at worst {load:.1%} of {c.bus.bitrate} bit/s (allowed {HIGHEST_LOAD:.0%}); "
        f"one exchange takes {exchange_ms:.2f} of {c.period_ms} ms",
        highlight=False,
    )
    click.echo(f"{robot.path}: good")


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for column in columns:
        table.add_column(column, no_wrap=True)
    return table


def _quantities(name: str, profile: DriveProfile) -> Table:
    table = _table(
        f"\ndrive profile {name} ({profile.eds})",
        *("quantity", "object", "sub", "type", "scale", "sign", "offset", "unit"),
    )
    for field, unit in QUANTITY_UNITS.items():
        where: Quantity | None = getattr(profile, field)
        if where is not None:
            table.add_row(
                field,
                f"0x{where.object:04X}",
                f"{where.subindex}",
                where.type,
                f"{where.scale:.6g}",
                f"{where.sign:+d}",
                f"{where.offset:g}",
                unit,
            )
        elif field in WITHOUT:
            table.add_row(field, "-", "", "", "", "", "", WITHOUT[field])
    return table


def _pdos(profile: DriveProfile) -> Table:
    table = _table("", "PDO", "COB-ID", "bytes", "mapping")
    for kind, pdos in (("TPDO", transmit_pdos(profile, 0)), ("RPDO", receive_pdos(profile, 0))):
        for pdo in pdos:
            mapping = ", ".join(
                f"{field.entry} 0x{field.index:04X}:{field.subindex:02X}/{field.bits}"
                for field in pdo.fields
            )
            cob_id = f"0x{pdo.cob_id:03X} + node"
            table.add_row(f"{kind}{pdo.number}", cob_id, str(pdo.layout.size), mapping)
    return table


def _joints(c: Configuration) -> Table:
    table = _table(
        "\njoints",
        "joint",
        "node",
        "gear",
        "A rated max",
        "signs m l",
        "zero rad",
        "K_c Nm/A",
        "gap mrad",
        "level Nm",
        "limits rad",
        "end",
    )
    for joint in c.joints:
        table.add_row(
            joint.name,
            str(joint.wiring.node),
            f"{joint.wiring.gear:g}",
            f"{joint.wiring.rated_current_A:g} {joint.wiring.max_current_A:g}",
            f"{joint.wiring.motor_sign:+d} {joint.wiring.link_sign:+d}",
            f"{joint.wiring.link_offset:g}",
            f"{joint.torque_constant:g}",
            f"{joint.half_gap * 1000:g}",
            f"{joint.thresholds.contact:g}",
            f"{joint.limits.lower:+.2f} {joint.limits.upper:+.2f}",
            joint.end,
        )
    return table


def _travels(c: Configuration) -> Table:
    table = _table(
        "\nat worst after the daemon's death",
        "joint",
        "rad/s",
        "patience ms",
        "rad/s2",
        "travel rad",
    )
    for joint in c.joints:
        profile = c.drives[joint.wiring.profile]
        travel = worst_travel(joint, profile)
        table.add_row(
            joint.name,
            f"{joint.limits.velocity:g}",
            str(profile.master_timeout_ms),
            f"{joint.limits.quick_stop:g}",
            f"{travel.total:.3f} = {travel.unaware:.3f} unaware + {travel.braking:.3f} braking",
        )
    return table


def _frames(frames: tuple[FrameLoad, ...]) -> Table:
    table = _table("\nframes", "COB-ID", "bytes", "rate/s", "bits", "what")
    for frame in sorted(frames, key=lambda f: f.cob_id):
        table.add_row(
            f"0x{frame.cob_id:03X}",
            str(frame.size),
            f"{frame.rate_hz:g}",
            str(frame.bits),
            frame.name,
        )
    return table
