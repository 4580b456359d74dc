"""`contactd check`: checks a configuration and prints what follows from it, without the bus."""

from pathlib import Path

from rich.console import Console
from rich.padding import Padding
from rich.table import Table

from common import compiled
from daemon.config.bounds import near
from daemon.config.checks import suspects
from daemon.config.convert import choices
from daemon.config.evidence import unarmable
from daemon.config.explanations import explain
from daemon.config.identified import Identified
from daemon.config.load import load_robot
from daemon.config.schema import Configuration, frames_of
from daemon.config.travels import travels
from daemon.config.worst_loads import Load, worst_loads
from daemon.drives import build_setups
from drivers.can.load import HIGHEST_LOAD, FrameLoad, bus_load
from drivers.canopen.boot.required_objects import lacks
from drivers.canopen.codec import receive_pdos, transmit_pdos
from drivers.canopen.settings import CanopenDrive, CanopenProfile, Quantity
from programs.command_line.console import on_stdout
from programs.command_line.sentences import say
from programs.contactctl.sensitivity_poses import sensitivity_over_poses
from programs.contactd.drafts.configuration import guesses
from programs.identify.stated_levels import source, unused

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
TRAVEL_WORDS = (
    "until found: until the fault is detected. in the stops: while they are commanded by setpoint, "
    "SDO and NMT. master missed: until the drive misses the master's heartbeat. in all: the sum, "
    "of a drive that ignores commands. too fast: a drive faster than its setpoint by speed_margin, "
    "until that is detected, and its quick stop from there. daemon dies: master missed and quick "
    "stop"
)
# Substitutes for quantities that a drive profile does not have.
WITHOUT = {
    "motor_position": "integrated from the velocity",
    "max_motor_speed": "the drive's own speed limit is left as it is",
}
FOLDED = "mapping"  # the column that may wrap


def print_check(config: Path) -> None:
    """Check a configuration, describe it, and report values near their bounds and likely mistakes.
    Raises ConfigurationError with all that is wrong."""
    robot = load_robot(config)
    c = robot.configuration
    console = on_stdout()
    loads = worst_loads(c, robot.model)
    wiring, joints, travelled = _wiring(c), _joints(c, loads), _travels(c)
    levels = _levels(c, robot.identified)
    quantities = {name: _quantities(name, profile) for name, profile in c.drives.items()}
    tables = [wiring, joints, levels, travelled, *quantities.values()]
    # On a narrow terminal a line that goes on in the next can still be read, a cut figure cannot.
    endless = console.options.update(width=1000)
    console.width = max(
        console.width, *(console.measure(t, options=endless).maximum for t in tables)
    )
    console.print(f"[bold]{c.name}[/bold]: {len(c.joints)} joints, every {c.period_ms} ms")
    setups = {setup.drive.wiring.profile: setup for setup in build_setups(robot)}
    for name, profile in c.drives.items():
        console.print(quantities[name])
        console.print(FORMULA, style="dim", highlight=False)
        for field, instead in WITHOUT.items():
            if getattr(profile, field) is None:
                _remark(console, f"without {field}: {instead}")
        console.print(_pdos(setups[name].drive))
        for lack in lacks(setups[name], c.period_ms, c.bus.master_node):
            _remark(console, lack)
    console.print(wiring, joints, levels, travelled)
    say(TRAVEL_WORDS, dim=True)
    console.print()
    for line in sensitivity_over_poses(c, robot.model):
        say(line)
    frames = frames_of(c)
    console.print(_frames(frames))
    load = bus_load(frames, c.bus.bitrate)
    exchange_ms = 1000.0 * sum(f.bits for f in frames if f.every_tick) / c.bus.bitrate
    say(
        f"bus load at worst {load:.1%} of {c.bus.bitrate} bit/s (allowed {HIGHEST_LOAD:.0%}); "
        f"one exchange takes {exchange_ms:.2f} of {c.period_ms} ms"
    )
    # At the end, where it is not overlooked.
    for joint, asked in zip(c.joints, loads, strict=True):
        if asked.too_much:
            say(
                f"{joint.name}: gravity is more than the motor can hold ({asked.gravity:.4g} Nm of "
                f"{asked.motor:.4g} Nm): are masses in kg and lengths in m?"
            )
    remarks = [*near(c, robot.model), *suspects(c, robot.urdf, robot.folder)]
    for problem in (*remarks, *unused(c, robot.identified)):
        say(robot.in_words(problem))
    for reason in unarmable(robot.identified, c, robot.urdf):
        say(f"`contactctl arm` will be refused: {reason}")
    if plain := compiled.warning():
        say(plain)
    if marked := guesses(robot.text):
        say(f"{robot.path}: {marked} lines still hold guesses (CHECK)")
    say(f"{robot.path}: good")


def print_explanation(field: str) -> None:
    """Print the meaning of a field, how to find it and typical values. Raises
    ConfigurationError."""
    for place, about in explain(field).items():
        say(f"{place}: {about.what}")
        if allowed := choices(Configuration, place):
            say(f"  allowed: {', '.join(allowed)}")
        say(f"  how to find it: {about.find}")
        say(f"  typical: {about.typical}")


def _remark(console: Console, text: str) -> None:
    """Print indented, over as many lines as it takes."""
    console.print(Padding(text, (0, 0, 0, 2), expand=False), highlight=False)


def _table(title: str, *columns: str, gap: int = 2) -> Table:
    table = Table(
        title=title, title_justify="left", box=None, pad_edge=False, padding=(0, gap, 0, 0)
    )
    for column in columns:
        table.add_column(column, no_wrap=column != FOLDED)
    return table


def _quantities(name: str, profile: CanopenProfile) -> Table:
    table = _table(
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
    table = _table("", "PDO", "COB-ID", "bytes", FOLDED)
    for kind, pdos in (("TPDO", transmit_pdos(drive)), ("RPDO", receive_pdos(drive))):
        for pdo in pdos:
            mapping = ", ".join(
                f"{field.entry} 0x{field.index:04X}:{field.subindex:02X}/{field.bits}"
                for field in pdo.fields
            )
            cob_id = f"0x{pdo.cob_id - drive.node:03X} + node"
            table.add_row(f"{kind}{pdo.number}", cob_id, str(pdo.layout.size), mapping)
    return table


def _wiring(c: Configuration) -> Table:
    table = _table(
        "\nwiring",
        *("joint", "node", "gear", "A rated", "A max", "K_c Nm/A", "signs m l", "zero rad"),
    )
    for joint in c.joints:
        table.add_row(
            joint.name,
            str(joint.wiring.node),
            f"{joint.wiring.gear:g}",
            f"{joint.wiring.rated_current_A:g}",
            f"{joint.wiring.max_current_A:g}",
            f"{joint.torque_constant:g}",
            f"{joint.wiring.motor_sign:+d} {joint.wiring.link_sign:+d}",
            f"{joint.wiring.link_offset:g}",
        )
    return table


def _joints(c: Configuration, loads: list[Load]) -> Table:
    """Table of joints; `gravity Nm` is the worst case, of the motor's torque at largest current."""
    table = _table("\njoints", "joint", "half-gap mrad", "limits rad", "gravity Nm", "end")
    for joint, load in zip(c.joints, loads, strict=True):
        table.add_row(
            joint.name,
            f"{joint.half_gap * 1000:g}",
            f"{joint.limits.lower:+.2f} {joint.limits.upper:+.2f}",
            f"{load.gravity:.2f} of {load.motor:.2f}",
            joint.end,
        )
    return table


def _levels(c: Configuration, found: Identified | None) -> Table:
    """Table of contact levels in force, the least that learning leaves, and their source."""
    table = _table("\ncontact levels", "joint", "contact Nm", "least Nm", "source")
    for joint, least in zip(c.joints, c.least_levels, strict=True):
        level = joint.thresholds.contact
        table.add_row(joint.name, f"{level:g}", f"{least:.4g}", source(joint, found))
    return table


def _travels(c: Configuration) -> Table:
    """Table of travels of the joints: if the daemon dies, and if their drives ignore commands."""
    table = _table(
        "\ntravel, at worst, from a fault at full speed until the joint stands",
        *("joint", "speed\nrad/s", "braking\nrad/s2", "until\nfound\nrad", "in the\nstops\nrad"),
        *("master\nmissed\nrad", "quick\nstop\nrad", "in all\nrad", "too\nfast\nrad"),
        "daemon\ndies\nrad",
        gap=1,
    )
    for drive, travel in zip(c.joint_drives, travels(c), strict=True):
        parts = (travel.noticing, travel.stages, travel.patience, travel.braking)
        table.add_row(
            drive.name,
            f"{drive.velocity:g}",
            f"{drive.quick_stop:g}",
            *(f"{part:.3f}" for part in parts),
            f"{travel.total:.3f}",
            f"{travel.own:.3f}",
            f"{travel.patience + travel.braking:.3f}",
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
