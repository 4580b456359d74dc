"""Reaction to faults: ticks until each is found, the stop command is sent, and the arm stands.

Every case of `bench.rigs.faults`, in lockstep, on the drives of every make, and what is none: an
exception in the tick, and a daemon that dies.

    python -m bench.reaction [--json]

Ticks count from the one in which the fault is made, which is the first. `found` is held against
what the fault's row in `daemon.faults.table` says; the stop command against two ticks after that.
Where the bus takes no frame, its ticks count from when it does. A fault exit is followed by
silence, at which the drives stop by themselves. `stands` is when no motor moves any more.
"""

import logging
import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

import click

from bench.report import Target, print_report
from bench.rigs.breakable_arm import BreakableArm, restore, start
from bench.rigs.faults import PLACES, SHOWN, Case, Place
from daemon.ending import stop_on_error
from daemon.faults.table import TABLE, Condition, Response
from daemon.modes.table import Mode
from errors import ProgramError
from simulator.state_machine import State

STOP_TICKS = 2
STANDS = 0.02  # [rad/s] of the fastest motor, at the link
PATIENCE_TICKS = 100
PERIOD_MS = 10  # of every make
WORDS = {
    Response.CONTINUE: "continue",
    Response.HOLD: "hold",
    Response.QUICK_STOP: "quick stop",
    Response.FAULT_EXIT: "fault exit",
}


def stop_sent(on: BreakableArm, reaction: Response) -> bool:
    """True where the stop command that belongs to a response was sent in this tick."""
    if reaction is Response.HOLD:
        return on.rig.mode is Mode.STOPPING and bool(on.setpoints())
    return on.stops


def measure(on: BreakableArm, case: Case) -> dict[str, Any]:
    """Make the fault; None where something did not happen, or is not asked for."""
    reaction = TABLE[case.condition].response
    fault = case.fault(on)
    found = stopped = stood = None
    obeyed = reaction in (Response.HOLD, Response.QUICK_STOP)
    mute = 0  # ticks after it was found in which the bus took nothing
    for tick in range(1, case.ticks + PATIENCE_TICKS):
        next(fault, None)
        if on.rig.tick.fatal:
            on.silence()  # as after its end
        else:
            on.tick()
        if found is None and any(f.condition is case.condition for f in on.rig.last.findings):
            found = tick
        if found and obeyed and stopped is None:
            if stop_sent(on, reaction):
                stopped = tick
            elif on.wire.sending:
                mute += 1
        if on.speed >= STANDS:
            stood = None
        elif found and stood is None:
            stood = tick
        if found and (reaction is Response.CONTINUE or (stood and (stopped or not obeyed))):
            break
    if hasattr(fault, "close"):
        fault.close()
    stops = reaction is not Response.CONTINUE
    return row(
        on,
        case,
        found_tick=found,
        stop_ticks_after_found=stopped - found - mute if found and stopped else None,
        mute_ticks=mute,
        stands_tick=stood if stops else None,
    )


def program_error(place: Place) -> dict[str, Any]:
    """An exception in the tick, in full motion."""
    logging.getLogger("contactd").addHandler(logging.NullHandler())  # its traceback is no news here
    with place.stage() as on:
        start(on, armed=True)
        stopped = []

        def sleep(_: float) -> None:
            stopped.append(on.stops)
            on.silence()

        on.rig.tick.controller = cast(Any, None)
        with suppress(ProgramError), stop_on_error(on.rig.tick.drives, on.period_s, sleep):
            on.tick()
        stands = 1 + len(stopped) + silent_ticks(on, lambda: on.speed < STANDS)
    return row(
        on,
        Case("exception in the tick", Condition.PROGRAM_ERROR, lambda _: iter(()), 1),
        found_tick=1,
        stop_ticks_after_found=stopped.index(True),
        stands_tick=stands,
    )


def killed(place: Place) -> dict[str, Any]:
    """Without the daemon: found is when the last drive has missed its heartbeat."""
    with place.stage() as on:
        start(on, armed=True)
        drives, c = on.rig.arm.drives, on.rig.robot.configuration
        timeout_ms = max(profile.master_timeout_ms for profile in c.drives.values())
        runs = State.OPERATION_ENABLED
        found = silent_ticks(on, lambda: all(drive.state is not runs for drive in drives))
        stands = found + silent_ticks(on, lambda: on.speed < STANDS)
    return {
        "make": place.make.name,
        "fault": "daemon killed",
        "condition": "(by the drives)",
        "reaction": "quick stop",
        "stated_ticks": math.ceil(timeout_ms / c.period_ms) + 1,
        "found_tick": found,
        "stop_ticks_after_found": 0,
        "mute_ticks": 0,
        "stands_tick": stands,
    }


def silent_ticks(on: BreakableArm, done: Callable[[], bool]) -> int:
    """Ticks without a daemon until something is so."""
    for tick in range(PATIENCE_TICKS):
        if done():
            return tick
        on.silence()
    raise AssertionError("never")


def row(on: BreakableArm, case: Case, **measured: int | None) -> dict[str, Any]:
    """Results of one fault that are printed and kept."""
    reaction = WORDS[TABLE[case.condition].response]
    found_as = {"condition": case.condition.value, "reaction": reaction}
    stated = {"make": on.make.name, "fault": case.name, **found_as}
    return {**stated, "stated_ticks": case.ticks, "mute_ticks": 0, **measured}


def line(row: dict[str, Any]) -> str:
    """One row of the printed table."""
    stop = row["stop_ticks_after_found"]
    words = "-" if stop is None else f"+{stop}"
    if row["reaction"] == "fault exit" and stop is None:
        words = "silence"
    elif row["mute_ticks"]:
        words += f" after {row['mute_ticks']} mute"
    stands = "-" if row["stands_tick"] is None else f"{row['stands_tick'] * PERIOD_MS} ms"
    return (
        f"{row['make']:8} {row['fault']:26} {row['condition']:29} {row['stated_ticks']:5} "
        f"{row['found_tick']!s:>6}  {row['reaction']:10} {words:15} {stands:>8}"
    )


def measured(place: Place) -> list[dict[str, Any]]:
    """Every fault that can be shown at a place."""
    rows = []
    shown = [each for each in SHOWN if each.place == place]
    with place.stage() as on:
        for case in (each.case for each in shown if each.recovers):
            start(on, armed=case.armed)
            rows.append(measure(on, case))
            restore(on)
    for case in (each.case for each in shown if not each.recovers):
        with place.stage() as on:
            start(on, armed=case.armed)
            rows.append(measure(on, case))
    return [*rows, program_error(place), killed(place)]


@click.command(help=__doc__)
@click.option("--json", "as_json", is_flag=True)
def main(as_json: bool) -> None:
    rows = [row for place in PLACES if place.wire == "virtual" for row in measured(place)]
    if not as_json:
        click.echo(
            f"{'make':8} {'fault':26} {'found as':29} {'ticks':>5} {'found':>6}  {'reaction':10} "
            f"{'stop command':15} {'stands':>8}"
        )
        for row in rows:
            click.echo(line(row))
    late = [r for r in rows if r["found_tick"] is None or r["found_tick"] > r["stated_ticks"]]
    waits = [r["stop_ticks_after_found"] for r in rows if r["reaction"] in ("hold", "quick stop")]
    moving = [r for r in rows if r["reaction"] != "continue" and r["stands_tick"] is None]
    worst = max(PATIENCE_TICKS if wait is None else wait for wait in waits)
    targets = [
        Target("faults found later than stated", len(late), 0, "", "lower"),
        Target("stop command after the fault was found", worst, STOP_TICKS, "ticks", "lower"),
        Target("faults after which the arm did not stand", len(moving), 0, "", "lower"),
    ]
    print_report("reaction", 1, targets, {"rows": rows}, as_json=as_json)


if __name__ == "__main__":
    main()
