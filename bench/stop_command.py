"""Ways to tell a drive to stop, against what may be wrong with it: which of them reaches it.

    python -m bench.stop_command [--json]

A quick stop in a synchronous RPDO, in an asynchronous one (transmission type 255), and written to
0x6040 by an expedited SDO, each sent once a tick to a drive in motion, with the harm done to it
before. Printed is after how many ticks the drive has left operation, `never` within 20, and what
the command costs on the bus, answers included. Drives of every make, in lockstep.
"""

from collections.abc import Callable, Iterator
from typing import Any

import click

from bench.options import help_of
from bench.report import Target, print_report
from bench.rigs.breakable_arm import MAKES, BreakableArm, Fault, Make, stage, start
from bench.rigs.bus_faults import sync_lost
from bench.rigs.drive_faults import left_operational, rpdo_off, sync_moved
from drivers.can.bus_load import frame_bits
from drivers.can.wire import Frame
from drivers.codec import receive_pdos
from drivers.expedited_stop import expedited_quick_stops
from drivers.ids import HEARTBEAT, OPERATIONAL, SYNC
from simulator.state_machine import State

TICKS = 20
ASYNCHRONOUS = 255
Way = Callable[[BreakableArm], list[Frame]]


def healthy(_: BreakableArm) -> Iterator[None]:
    yield


HARMS: dict[str, Fault] = {
    "none": healthy,
    "SYNC lost": sync_lost,
    "SYNC moved (0x1005)": sync_moved,
    "RPDO turned off": rpdo_off,
    "pre-operational": left_operational,
}


def by_rpdo(on: BreakableArm) -> list[Frame]:
    """As the drive's RPDOs are set up: synchronous, unless it was told otherwise before."""
    return [
        (pdo.cob_id, pdo.layout.pack(*(2 if f.entry == "controlword" else 0 for f in pdo.fields)))
        for pdo in receive_pdos(on.drive)
    ]


def by_sdo(on: BreakableArm) -> list[Frame]:
    """One frame, and one as its answer."""
    return expedited_quick_stops([on.drive])


WAYS: dict[str, Way] = {"synchronous RPDO": by_rpdo, "asynchronous RPDO": by_rpdo, "SDO": by_sdo}


def ticks_until_stopped(make: Make, harm: Fault, way: str) -> int | None:
    """Ticks until the drive has left operation; None within `TICKS`."""
    with stage(make) as on:
        start(on, armed=False)
        if way.startswith("asynchronous"):
            for pdo in receive_pdos(on.drive):
                data = bytes([0x2F, pdo.number - 1, 0x14, 2, ASYNCHRONOUS, 0, 0, 0])
                on.simulated.on_sdo(data)
        fault = harm(on)
        next(fault)
        heard = [(HEARTBEAT + 127, bytes([OPERATIONAL])), (SYNC, b"")]
        for tick in range(1, TICKS + 1):
            on.wire.send([*WAYS[way](on), *heard])
            on.rig.lockstep.pump()
            if on.simulated.axis.state is not State.OPERATION_ENABLED:
                return tick
            next(fault, None)
    return None


def cost_bits(make: Make, way: str) -> int:
    """Bits on the bus of one command, at worst."""
    with stage(make) as on:
        frames = WAYS[way](on)
    answers = frame_bits(8) if way == "SDO" else 0
    return sum(frame_bits(len(data)) for _, data in frames) + answers


@click.command(help=help_of(__doc__))
@click.option("--json", "as_json", is_flag=True)
def main(as_json: bool) -> None:
    rows: list[dict[str, Any]] = []
    for make in MAKES:
        for name, harm in HARMS.items():
            if (make.name, name) == ("desk arm", "SYNC moved (0x1005)"):
                continue  # its drives have no such object
            ticks = {way: ticks_until_stopped(make, harm, way) for way in WAYS}
            rows.append({"make": make.name, "harm": name, "ticks": ticks})
    cost = {make.name: {way: cost_bits(make, way) for way in WAYS} for make in MAKES}
    if not as_json:
        click.echo(f"{'make':9} {'harm':20} " + " ".join(f"{way:>18}" for way in WAYS))
        for row in rows:
            shown = ["never" if t is None else str(t) for t in row["ticks"].values()]
            figures = " ".join(f"{text:>18}" for text in shown)
            click.echo(f"{row['make']:9} {row['harm']:20} {figures}")
        for name, bits in cost.items():
            figures = " ".join(f"{count:>13} bits" for count in bits.values())
            click.echo(f"{name:9} {'cost':20} {figures}")
    missed = [r for r in rows if r["ticks"]["SDO"] is None]
    target = Target("harms that an SDO stop does not get past", len(missed), 0, "", "lower")
    print_report("stop_command", 1, [target], {"rows": rows, "cost_bits": cost}, as_json=as_json)


if __name__ == "__main__":
    main()
