"""`contactd scan`: lists the nodes on the bus with the matching EDS files; reads only."""

import math
from pathlib import Path

import click
import msgspec

from common.errors import ConfigurationError
from common.yaml_source import Source, read_yaml
from daemon.config.convert import convert
from drivers.can.bus import open_bus
from drivers.can.settings import BusSettings
from drivers.canopen.boot.data_sheet import load_data_sheet, makers_numbers
from drivers.canopen.boot.scan import FoundNode, scan
from drivers.damiao import scan as damiao
from drivers.damiao.frames import ANSWERS, Register
from drivers.robstride import scan as robstride
from drivers.robstride.frames import Parameter
from drivers.robstride.settings import serial_of
from programs.command_line.sentences import aligned, say


class _Bus(msgspec.Struct, frozen=True):
    """Only part of `config.yaml` that is read, as the rest may not be written yet."""

    bus: BusSettings


def run_scan(config: Path, port: int | None) -> None:
    """Print the nodes that answer on the bus of a folder's config.yaml. Raises ContactdError."""
    path = config / "config.yaml" if config.is_dir() else config
    bus = bus_of(read_yaml(path))
    if port is not None:
        bus = msgspec.structs.replace(bus, port=port)
    sheets = data_sheets(path.parent)
    where = f"{bus.interface} {bus.channel}"
    say(f"listening for a master on {where}, then querying 127 nodes: about fifteen seconds")
    opened = open_bus(bus)
    try:
        found = scan(opened.wire)
        motors = motor_table(damiao.scan_motors(opened.wire))
        motors += robstride_table(robstride.scan_motors(opened.wire))
    finally:
        opened.python_can.shutdown()
    lines = table(found, sheets) if found or not motors else []
    for line in [*lines, *motors]:
        click.echo(line)


def bus_of(source: Source) -> BusSettings:
    """`bus` of a configuration; nothing else is checked. Raises ConfigurationError."""
    if not isinstance(source.data, dict) or "bus" not in source.data:
        raise ConfigurationError(f"{source.path}: `bus` is missing")
    return convert(source, _Bus).bus


def data_sheets(folder: Path) -> dict[str, dict[str, int]]:
    """VendorNumber and ProductNumber of each readable EDS in a folder, by file name."""
    sheets = {}
    for path in sorted(folder.glob("*.[eE][dD][sS]")):
        try:
            sheets[path.name] = makers_numbers(load_data_sheet(path))
        except ConfigurationError as error:
            click.echo(str(error), err=True)
    return sheets


def table(found: list[FoundNode], sheets: dict[str, dict[str, int]]) -> list[str]:
    """Nodes found, as lines of a table."""
    if not found:
        return [
            "no node answers: are the drives powered, is the bitrate right, is the bus terminated?"
        ]
    rows = [("node", "vendor", "product", "serial", "modes", "EDS")]
    rows += [
        (
            str(one.node),
            _hex(one.vendor),
            _hex(one.product),
            "-" if one.serial is None else str(one.serial),
            (one.mode_names or "-") if one.is_drive else "no drive by CiA 402",
            ", ".join(fitting(one, sheets)) or "none in this folder",
        )
        for one in found
    ]
    return aligned(rows) + [
        f"two drives answer as node {one.node}: switch one off and give it another node ID"
        for one in found
        if one.twice
    ]


def motor_table(motors: list[damiao.FoundMotor]) -> list[str]:
    """Damiao motors found, as lines of a table; registers have their names in a profile."""
    if not motors:
        return []
    head = "id", "master id", "model by its gear", "position_max", "velocity_max", "torque_max_Nm"
    rows: list[tuple[str, ...]] = [(*head, "firmware", "serial")]
    for one in motors:
        master, _, *others = (f"{value:.7g}" for value in one.values.values())
        rows.append((str(one.motor), master, " or ".join(one.models) or "unknown", *others))
    return [
        *aligned(rows),
        *(
            f"motor {one.motor}: register {Register.MASTER_ID.value} (master id) must be "
            f"{one.motor + ANSWERS}"
            for one in motors
            if one.values[Register.MASTER_ID] != one.motor + ANSWERS
        ),
        *(f"two motors answer with id {one.motor}" for one in motors if one.twice),
    ]


def robstride_table(motors: list[robstride.FoundMotor]) -> list[str]:
    """RobStride motors found, as lines of a table."""
    if not motors:
        return []
    head = "id", "mode", "torque limit in Nm", "position in rad", "supply in V"
    rows: list[tuple[str, ...]] = [(*head, "serial (of `wiring`)", "number of its controller")]
    for one in motors:
        uid = one.uids[0]
        numbers = (f"{value:.4g}" for value in one.values.values())
        rows.append((str(one.motor), *numbers, str(serial_of(uid)), f"{uid:016X}"))
    return [
        *aligned(rows),
        *(
            f"motor {one.motor} counts from 0 to one turn at power-up: set its zero_sta to 1"
            for one in motors
            if one.values[Parameter.POSITION] > math.pi
        ),
        *(f"two motors answer with id {one.motor}" for one in motors if len(one.uids) > 1),
    ]


def fitting(one: FoundNode, sheets: dict[str, dict[str, int]]) -> list[str]:
    """Names of the EDS files whose vendor and product numbers, if stated, match a node."""
    return [
        name
        for name, numbers in sheets.items()
        if numbers
        and numbers.get("VendorNumber", one.vendor) == one.vendor
        and numbers.get("ProductNumber", one.product) == one.product
    ]


def _hex(value: int | None) -> str:
    return "-" if value is None else f"0x{value:X}"
