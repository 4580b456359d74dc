"""Reaction to faults: when each is found, and the stop commanded and proved; how far joints go; and
whether one reset is enough.

Every case of `bench.rigs.faults`, in lockstep, on the drives of every make, and what is none: an
exception in the tick, and a daemon that dies.

    python -m bench.reaction [--part singles|pairs] [--sample N] [--seed S] [--json]

Ticks, of 10 ms, count from the one in which the fault is made, which is the first. `found` is held
against what its row in `daemon.faults.table` says; the stop command against two ticks after that.
Where the bus takes no frame, its ticks count from when it does. `proved` is when every drive was
seen to stand; `silence` where nothing can say so, and the drives are left to stop by themselves;
those that would let go in silence are `commanded` on.
`stands` is when no motor moves any more. `travel` is that of the joint that came nearest to what
`contactd check` prints, from the fault on, beside that figure (`own way` where a drive runs away);
joints that a hand moves faster than any setpoint are printed, and not held against it.
`reset` is whether one, as a client asks for it, was enough when the cause was gone.

Faults of one drive are made at nearly its full speed, too.

`--part pairs` makes every two faults on one arm, the second 4, 20 or 60 ticks after the first,
and compares what the daemon says with what the simulated motors do: nothing may be said to stand,
nor `reset` be accepted, while a joint moves by itself, and no frame of ours may take the power of
one that moves before a ramp was tried. `--sample N --seed S` tries N of them by chance.
"""

import logging
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import Any, cast

import click
import numpy as np

from bench.options import command
from bench.report import Target, print_report
from bench.rigs.breakable_arm import BreakableArm, start
from bench.rigs.bus_faults import pdos_stale
from bench.rigs.drive_faults import heartbeat_lost, runaway, samples_repeat, stone_deaf
from bench.rigs.faults import PLACES, SHOWN, Case, MakeOnWire
from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.measurement_faults import all_frozen, encoder_frozen
from bench.study.fault_pairs import PAIRS, judged_each, sampled
from common.errors import ProgramError
from daemon.faults.conditions import Condition, Response
from daemon.faults.table import TABLE
from daemon.modes.table import Event, Mode
from daemon.shutdown import stop_on_error
from drivers.motors.guardian import Activity

STOP_TICKS = 2
STANDS = 0.02  # [rad/s] of the fastest motor, at the link
PATIENCE_TICKS = 100
FULL_SPEED = 0.95  # of the velocity limit
FAST = (all_frozen, encoder_frozen, samples_repeat, pdos_stale, stone_deaf, heartbeat_lost, runaway)
# Made at nearly full speed, too. A drive that hears no setpoint any more is not among them: it goes
# on as commanded until its setpoints are others.


def stop_sent(on: BreakableArm, reaction: Response) -> bool:
    """True where the stop command that belongs to a response was sent in this tick."""
    if reaction is Response.HOLD:
        return on.rig.mode is Mode.STOPPING and bool(on.setpoints())
    return on.stops


@dataclass
class Course:
    """Course of one fault: in which tick each thing happened; None where it did not."""

    reaction: Response
    began: np.ndarray
    found: int | None = None
    reported: int | None = None
    mute: int = 0  # ticks after it was found in which the bus took nothing
    stood: int | None = None
    proved: int | None = None
    furthest: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.furthest = np.zeros(self.began.shape[1])

    @property
    def stops(self) -> bool:
        """True where the drives are commanded to stop, other than by the end of the program."""
        return self.reaction in (Response.HOLD, Response.QUICK_STOP)

    def see(self, on: BreakableArm, case: Case, tick: int) -> None:
        """Take note of a tick."""
        if self.found is None and case.condition in {f.condition for f in on.rig.last.findings}:
            self.found = tick
        if on.speed >= STANDS:
            self.stood = None
        elif self.found and self.stood is None:
            self.stood = tick
        self.furthest = np.maximum(self.furthest, np.abs(on.joints - self.began).max(axis=0))
        if self.found is None:
            return
        if self.stops and self.reported is None:
            self.reported = tick if stop_sent(on, self.reaction) else None
            self.mute += self.reported is None and on.mute
        if self.proved is None and not on.rig.last.unproved:
            self.proved = tick

    def over(self, on: BreakableArm) -> bool:
        """True when nothing more is to be expected."""
        if not self.found or self.reaction is Response.CONTINUE:
            return bool(self.found)
        latched = self.reaction is Response.QUICK_STOP
        seen = not latched or bool(self.proved) or on.rig.tick.drives.silenced
        return bool(self.stood) and seen and not (self.stops and self.reported is None)


def measure(on: BreakableArm, case: Case) -> dict[str, Any]:
    """Make the fault; None where something did not happen, or is not asked for."""
    course = Course(TABLE[case.condition].response, on.joints)
    fault = case.fault(on)
    for tick in range(1, case.ticks + PATIENCE_TICKS):
        next(fault, None)
        if on.rig.tick.fatal:
            on.silence()  # as after its end
        else:
            on.tick()
        course.see(on, case, tick)
        if course.over(on):
            break
    if hasattr(fault, "close"):
        fault.close()
    found, reported = course.found, course.reported
    moved = course.reaction is not Response.CONTINUE
    latched = course.reaction is Response.QUICK_STOP
    bound = on.own_travel if case.own else on.travel
    nearest = int(np.argmax(course.furthest / bound))
    return row(
        on,
        case,
        found_tick=found,
        stop_ticks_after_found=reported - found - course.mute if found and reported else None,
        mute_ticks=course.mute,
        stands_tick=course.stood if moved else None,
        proved_tick=course.proved if latched else None,
        silenced=on.rig.tick.drives.silenced,
        commanded=on.make.speech.stops_by_ramp,
        obeys=case.obeys,
        travel_rad=float(course.furthest[nearest]) if moved else None,
        travel_printed_rad=float(bound[nearest]) if moved else None,
        driven=case.driven,
        one_reset=one_reset(on) if latched else None,
    )


def one_reset(on: BreakableArm) -> bool:
    """Whether one reset, asked again while the arm is not seen to stand as a client does, brings
    the arm off, and it can be enabled after it."""
    drives = on.rig.drives
    on.run(0.1)
    for _ in range(PATIENCE_TICKS):
        if drives.master_timeout_passed or not (drives.silenced or drives.unproved()):
            break
        on.tick()
    try:
        on.rig.reset()
        on.until(Mode.HOLDING, Event.ENABLE)
    except AssertionError:
        return False
    return True


def program_error(place: MakeOnWire) -> dict[str, Any]:
    """An exception in the tick, in full motion."""
    logging.getLogger("contactd").addHandler(logging.NullHandler())  # its traceback is no news here
    with place.stage() as on:
        start(on, armed=True)
        stopped = []

        def sleep(_: float) -> None:
            stopped.append(on.stops)
            on.silence()

        on.rig.tick.controller = cast(Any, None)
        with suppress(ProgramError), stop_on_error(on.rig.drives, on.period_s, sleep):
            on.tick()
        stands = 1 + len(stopped) + silent_ticks(on, lambda: on.speed < STANDS)
    return row(
        on,
        Case("exception in the tick", Condition.PROGRAM_ERROR, lambda _: iter(()), 1),
        found_tick=1,
        stop_ticks_after_found=stopped.index(True),
        stands_tick=stands,
    )


def killed(place: MakeOnWire) -> dict[str, Any]:
    """Without the daemon: found is when the last drive has missed it, or the guardian holds."""
    with place.stage() as on:
        start(on, armed=True)
        c = on.rig.robot.configuration
        timeout_ms = max(profile.master_timeout_ms for profile in c.drives.values())
        found = silent_ticks(on, lambda: unheard(on))
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


def unheard(on: BreakableArm) -> bool:
    """Whether every drive has stopped by itself, or the guardian holds them."""
    if isinstance(on.rig.guard, GuardianAtBus):
        return on.rig.guard.guardian.activity is Activity.HOLDS
    return on.make.speech.operating not in on.states


def silent_ticks(on: BreakableArm, done: Callable[[], bool]) -> int:
    """Ticks without a daemon until something is so."""
    for tick in range(PATIENCE_TICKS):
        if done():
            return tick
        on.silence()
    raise AssertionError("never")


def row(on: BreakableArm, case: Case, **measured: float | None) -> dict[str, Any]:
    """Results of one fault that are printed and kept."""
    reaction = TABLE[case.condition].response.name.lower().replace("_", " ")
    found_as = {"condition": case.condition.value, "reaction": reaction}
    stated = {"make": on.make.name, "fault": case.name, **found_as}
    return {**stated, "stated_ticks": case.ticks, "mute_ticks": 0, **measured}


def measured(place: MakeOnWire) -> list[dict[str, Any]]:
    """Every fault that can be shown at a place, each on an arm of its own."""
    rows = []
    for case in (each.case for each in SHOWN if each.place == place):
        for speed in (0.0, FULL_SPEED) if case.fault in FAST else (0.0,):
            with place.stage(speed) as on:
                start(on, armed=case.armed)
                rows.append(measure(on, case) | {"speed": speed})
    return [*rows, program_error(place), killed(place)]


@command(__doc__)
@click.option("--part", type=click.Choice(["singles", "pairs"]), default="singles")
@click.option("--sample", type=click.IntRange(min=1, max=len(PAIRS)), help="So many of the pairs.")
@click.option("--seed", type=int, default=1, help="Of the sample.")
def main(part: str, sample: int | None, seed: int, as_json: bool) -> None:
    logging.getLogger("contactd").setLevel(logging.CRITICAL)  # what a reset mends is no news here
    if part == "pairs":
        pairs(sample, seed, as_json=as_json)
    else:
        singles(as_json=as_json)


def pairs(sample: int | None, seed: int, *, as_json: bool) -> None:
    """Every two faults on one arm, or a sample of them."""
    rows = []
    for pair, verdict in judged_each(sampled(sample, seed)):
        rows.append({"pair": str(pair), **asdict(verdict)})
        if not (verdict.good or as_json):
            click.echo(f"{pair}: {verdict}")
    targets = [
        Target("pairs in which a joint was said to stand, and moved", _count(rows, "proved"), 0),
        Target("pairs in which a reset was open while one moved", _count(rows, "reset"), 0),
        Target("pairs in which power was cut in motion, no ramp tried", _count(rows, "cut"), 0),
        Target("pairs", len(rows), sample or len(PAIRS), better="higher"),
    ]
    print_report("reaction, pairs", seed, targets, {"rows": rows}, as_json=as_json)


def _count(rows: list[dict[str, Any]], what: str) -> int:
    return sum(bool(row[what]) for row in rows)


def singles(*, as_json: bool) -> None:
    """Every fault alone, on the drives of every make."""
    rows = [row for place in PLACES if place.wire == "virtual" for row in measured(place)]
    late = [r for r in rows if r["found_tick"] is None or r["found_tick"] > r["stated_ticks"]]
    waits = [r["stop_ticks_after_found"] for r in rows if r["reaction"] in ("hold", "quick stop")]
    moving = [r for r in rows if r["reaction"] != "continue" and r["stands_tick"] is None]
    held = [r for r in rows if r.get("travel_rad") is not None and not r["driven"]]
    further = [r for r in held if r["travel_rad"] > r["travel_printed_rad"]]
    latched = [r for r in rows if r.get("one_reset") is not None]
    open_ends = [
        r
        for r in latched
        if r["proved_tick"] is None and not (r["silenced"] or r["obeys"] or r["commanded"])
    ]
    unended = [r for r in latched if not r["one_reset"]]
    share = max(r["travel_rad"] / r["travel_printed_rad"] for r in held)
    worst = max(PATIENCE_TICKS if wait is None else wait for wait in waits)
    targets = [
        Target("faults found later than stated", len(late), 0),
        Target("stop command after the fault was found", worst, STOP_TICKS, "ticks"),
        Target("faults after which the arm did not stand", len(moving), 0),
        Target("stops neither proved nor ended in silence", len(open_ends), 0),
        Target("faults after which a joint went further", len(further), 0),
        Target("travel over what is printed, at most", share, 1.0),
        Target("faults that one reset did not end", len(unended), 0),
    ]
    print_report("reaction", 1, targets, {"rows": rows}, as_json=as_json)


if __name__ == "__main__":
    main()
