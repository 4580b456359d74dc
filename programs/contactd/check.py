"""`contactd check`: validates a configuration and prints derived figures, without using the bus."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from common import compiled
from daemon.config.bounds import near
from daemon.config.checks import suspects
from daemon.config.convert import choices
from daemon.config.evidence import outdated, unarmable, unidentified
from daemon.config.identified import Identified
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration, frames_of
from daemon.config.shapes import Walls, clearance_of
from daemon.config.worst_loads import Load, worst_loads
from drivers.can.load import HIGHEST_LOAD, FrameLoad, bus_load
from drivers.can.wire import IDENTIFIER
from programs.command_line.console import on_stdout
from programs.command_line.sentences import say
from programs.contactctl.sensitivity_poses import sensitivity_over_poses
from programs.contactd.check_drives import add_merged, drives_in_words, new_table, remark
from programs.contactd.drafts.configuration import guesses
from programs.contactd.explanations import explain
from programs.contactd.travels import travels
from programs.identify.stated_levels import source, unused

TRAVEL_WORDS = (
    "until found: before the fault is detected. in the stops: during the escalating stop commands. "
    "master missed: until a drive reacts to the silence of contactd. in all: the sum of these and "
    "the quick stop, for a drive that ignores commands. too fast: for a drive that exceeds its "
    "setpoint by speed_margin, until that is detected, plus its quick stop. daemon dies: master "
    "missed plus quick stop; falls: the drive lets go instead"
)

_POSES = 100  # random poses within the limits, sampled for links that are always inside a shape


def print_check(config: Path) -> None:
    """Check a configuration, describe it, and report values near their bounds and likely mistakes.
    Raises ConfigurationError that lists all errors."""
    robot = load_robot(config)
    c = robot.configuration
    console = on_stdout()
    loads = worst_loads(c, robot.model)
    wiring, joints, travelled = _wiring(c), _joints(c, loads), _travels(c)
    levels = _levels(c, robot.identified)
    about = drives_in_words(robot)
    tables = [wiring, joints, levels, travelled, *(one for one in about if isinstance(one, Table))]
    # On a narrow terminal a wrapped line can still be read, a truncated figure cannot.
    endless = console.options.update(width=1000)
    console.width = max(
        console.width, *(console.measure(t, options=endless).maximum for t in tables)
    )
    console.print(f"[bold]{c.name}[/bold]: {len(c.joints)} joints, every {c.period_ms} ms")
    for one in about:
        if isinstance(one, Table):
            console.print(one)
        else:
            remark(console, one)
    console.print(wiring, joints, levels, travelled)
    say(TRAVEL_WORDS, dim=True)
    _say_alone(c)
    console.print()
    for line in sensitivity_over_poses(c, robot.model):
        say(line)
    if robot.walls is not None:
        say(robot.walls.in_words)
        _say_places(robot)
        _say_inside(robot, robot.walls)
    _print_bus(console, c)
    # Warnings come last, where they are not overlooked.
    for joint, asked in zip(c.joints, loads, strict=True):
        if asked.too_much:
            say(
                f"{joint.name}: gravity exceeds what the motor can hold ({asked.gravity:.4g} Nm of "
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


def _say_places(robot: Robot) -> None:
    """Report why links may not be where their shapes are assumed: outdated or unmeasured zeros."""
    c, entries = robot.configuration, robot.identified.joints if robot.identified else {}
    void = [outdated(step, robot.identified, c, robot.urdf) for step in ("wiring", "zero")]
    if unidentified("wiring", robot.identified, c) or any(void):
        say("shapes: none is guarded until wiring and zeros hold (`contactd identify wiring`)")
    if names := [j for j in c.joint_names if getattr(entries.get(j), "zero", None) is None]:
        say(
            f"shapes: no more accurate than the zeros of {', '.join(names)}, which config.yaml "
            "states and no step measured (`contactd identify zero`)"
        )


def _say_inside(robot: Robot, walls: Walls) -> None:
    """Report links that are inside a plane or box in all poses: left out by `contactd shapes`, or
    because the plane or box was moved since."""
    joints, bodies = robot.configuration.joints, robot.model.bodies()
    clearance = clearance_of(walls, bodies, robot.configuration.joint_names)
    most = np.full(len(clearance.pairs), -np.inf)
    lower, upper = np.array([(j.limits.lower, j.limits.upper) for j in joints]).T
    for q in np.random.default_rng(1).uniform(lower, upper, (_POSES, len(joints))):
        clearance.at(q)
        most = np.maximum(most, clearance.least)
    held = {one.pair for one in walls.shapes.left_out}
    for number in np.unique(clearance.whole).tolist():
        if most[number] < 0.0:
            first, second = clearance.pairs[number]
            held.add((first.name, second.name))
    for name in (*walls.surroundings.planes, *walls.surroundings.boxes):
        if links := sorted(first for first, second in held if second == name):
            say(f"surroundings: {name} holds {', '.join(links)} in all poses: is its place right?")


def _say_alone(c: Configuration) -> None:
    """Report each drive profile's behaviour without the master, grouped where it is the same."""
    alone: dict[str, list[str]] = {}
    for name, profile in c.drives.items():
        alone.setdefault(profile.timeout_reaction, []).append(name)
    for timeout_reaction, names in alone.items():
        say(f"{', '.join(names)}: {timeout_reaction}")


def _print_bus(console: Console, c: Configuration) -> None:
    frames = frames_of(c)
    console.print(_frames(frames, c.joint_names))
    load = bus_load(frames, c.bus.bitrate)
    exchange_ms = 1000.0 * sum(f.bits for f in frames if f.every_tick) / c.bus.bitrate
    say(
        f"bus load at worst {load:.1%} of {c.bus.bitrate} bit/s (allowed {HIGHEST_LOAD:.0%}); "
        f"one exchange takes {exchange_ms:.2f} of {c.period_ms} ms"
    )


def print_explanation(field: str) -> None:
    """Print the meaning of a field, how to find it and typical values. Raises
    ConfigurationError."""
    for place, about in explain(field).items():
        say(f"{place}: {about.what}")
        if allowed := choices(Configuration, place):
            say(f"  allowed: {', '.join(allowed)}")
        say(f"  how to find it: {about.find}")
        say(f"  typical: {about.typical}")


def _wiring(c: Configuration) -> Table:
    table = new_table(
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
    """Table of joints; `gravity Nm`: worst-case load, of the motor's torque at maximum current."""
    table = new_table("\njoints", "joint", "half-gap mrad", "limits rad", "gravity Nm", "end")
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
    """Table of contact levels in force, the lower bound that learning respects, and the source."""
    table = new_table("\ncontact levels", "joint", "contact Nm", "least Nm", "source")
    levels = zip(c.joints, c.least_levels, strict=True)
    add_merged(
        table,
        ((joint.name, f"{joint.thresholds.contact:g}", f"{least:.4g}", source(joint, found))
         for joint, least in levels),
    )  # fmt: skip
    return table


def _travels(c: Configuration) -> Table:
    """Table of the joints' stopping travels: if drives ignore commands, and if the daemon dies."""
    table = new_table(
        "\ntravel, at worst, from a fault at full speed until the joint stands",
        *("joint", "speed\nrad/s", "braking\nrad/s2", "until\nfound\nrad", "in the\nstops\nrad"),
        *("master\nmissed\nrad", "quick\nstop\nrad", "in all\nrad", "too\nfast\nrad"),
        "daemon\ndies\nrad",
        gap=1,
    )
    rows = []
    for drive, travel in zip(c.joint_drives, travels(c), strict=True):
        parts = (travel.detection, travel.stages, travel.master_timeout, travel.braking)
        rows.append((
            drive.name,
            f"{drive.velocity:g}",
            f"{drive.quick_stop:g}",
            *(f"{part:.3f}" for part in parts),
            f"{travel.total:.3f}",
            f"{travel.own:.3f}",
            f"{travel.master_timeout + travel.braking:.3f}"
            if drive.profile.stops_alone else "falls",
        ))  # fmt: skip
    add_merged(table, rows)
    return table


def _frames(frames: tuple[FrameLoad, ...], joints: Sequence[str]) -> Table:
    """Table of frames; frames that differ only by joint share a row."""
    table = new_table("\nframes", "COB-ID", "bytes", "rate/s", "bits", "what")
    alike: dict[tuple[str, ...], list[str]] = {}
    for frame in sorted(frames, key=lambda f: f.cob_id):
        of, _, what = frame.name.partition(" ")
        what = f"{what}, each joint" if of in joints else frame.name
        cells: tuple[str, ...] = str(frame.size), f"{frame.rate_hz:g}", str(frame.bits), what
        alike.setdefault(cells, []).append(f"0x{frame.cob_id & IDENTIFIER:03X}")
    for cells, ids in alike.items():
        table.add_row(ids[0] if ids[-1] == ids[0] else f"{ids[0]} to {ids[-1]}", *cells)
    return table
