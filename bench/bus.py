"""CPU time of one full exchange, against the same exchange with stock `canopen` PDO objects.

    python -m bench.bus [--exchanges N] [--rounds N] [--json]

SYNC out, 14 TPDOs in, every quantity in SI units as arrays; target velocities in, 7 RPDOs out:
once with `drivers.drives`, once as the documentation of canopen shows it (`RemoteNode`, PDO
variables, a `Notifier`), on python-can's virtual bus, for the seven drives of Romeo's arm, in one
run. Only the near side is counted: the CPU time of the whole process (a Notifier works in a thread
of its own) less what the far end of the bus took. Both read the same counts and send the same
bytes.
"""

import itertools
import statistics
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Protocol

import can
import canopen
import click
import numpy as np
from can.interfaces.virtual import VirtualBus
from numpy.typing import NDArray

from arrays import Vector
from bench.options import help_of
from bench.report import Target, print_report
from bench.rigs.lockstep import ROMEO
from bench.rigs.message_wire import MessageWire
from daemon.assembly import build_setups
from daemon.config.load import load_robot
from drivers.boot.required_objects import DriveSetup
from drivers.can.frame_ring import FrameRing, RecordedWire
from drivers.can.virtual import QueueWire
from drivers.can.wire import Wire
from drivers.cia402 import PowerTarget
from drivers.codec import MEASURED, link_side, receive_pdos, transmit_pdos
from drivers.drives import Drives

OPERATION_ENABLED: Final = 0x0027
ENABLE_OPERATION: Final = 0x000F
# Where the rings of the black box would be on a robot, in memory.
SHARED_MEMORY: Final = "/dev/shm" if Path("/dev/shm").is_dir() else None
SIDES: Final = {
    "ours": "drivers.drives",
    "own_calls": "drivers.drives over bus.recv, bus.send",
    "stock": "canopen PDOs and a Notifier",
}
MOVING: Final = {"current", "motor_velocity", "link_position", "motor_position"}


class Master(Protocol):
    """One side of the comparison."""

    def request(self) -> None:
        """Send SYNC."""

    def finish(self, velocity: Vector) -> NDArray[np.float64]:
        """Take the 14 TPDOs, command `velocity`; returns (quantities, joints) in SI units."""


class Ours:
    """The hot path of the daemon, which also keeps every frame for the black box."""

    def __init__(
        self, wire: Wire, setups: list[DriveSetup], period_s: float, ring: FrameRing
    ) -> None:
        drives = [setup.drive for setup in setups]
        self._drives = Drives(RecordedWire(wire, ring), drives, period_s, time.monotonic)
        self._tick, self._period_s = 0, period_s

    def request(self) -> None:
        self._tick += 1
        self._drives.sync(self._tick * self._period_s)

    def finish(self, velocity: Vector) -> NDArray[np.float64]:
        samples = self._drives.collect(time.monotonic() + 1.0)
        self._drives.command(PowerTarget.ON, velocity)
        assert samples.fresh.all()
        assert samples.motor_position is not None
        return np.array(
            [
                samples.current,
                samples.link_position,
                samples.motor_velocity,
                samples.motor_position,
            ]
        )


class Stock:
    """canopen's own PDO objects, filled by a Notifier's thread."""

    def __init__(self, bus: can.BusABC, setups: list[DriveSetup]) -> None:
        self._network = canopen.Network(bus)
        self._notifier = can.Notifier(bus, self._network.listeners, timeout=0.02)
        self._complete = threading.Event()
        self._received = 0
        self._statuswords: list[Any] = []
        self._measured: list[list[tuple[Any, float, float]]] = []
        self._targets: list[tuple[Any, Any, float, float]] = []
        self._rpdos: list[Any] = []
        self._tpdos = 0
        for setup in setups:
            self._add(setup)

    def _add(self, setup: DriveSetup) -> None:
        drive = setup.drive
        node = self._network.add_node(drive.node, setup.data_sheet)
        found: dict[str, Any] = {}
        for kind, pdos in (
            (node.tpdo, transmit_pdos(drive)),
            (node.rpdo, receive_pdos(drive)),
        ):
            for pdo in pdos:
                stock = kind[pdo.number]
                stock.clear()
                stock.cob_id, stock.enabled = pdo.cob_id, True
                for field in pdo.fields:
                    found[field.entry] = stock.add_variable(field.index, field.subindex)
                if kind is node.tpdo:
                    stock.add_callback(self._count)
                    stock.subscribe()
                    self._tpdos += 1
                else:
                    self._rpdos.append(stock)
        self._measured.append([(found[e], *link_side(drive, e)) for e in MEASURED])
        self._statuswords.append(found["statusword"])
        affine = link_side(drive, "target_velocity")
        self._targets.append((found["controlword"], found["target_velocity"], *affine))

    def _count(self, _: Any) -> None:
        self._received += 1
        if self._received == self._tpdos:
            self._complete.set()

    def request(self) -> None:
        self._complete.clear()
        self._received = 0
        self._network.sync.transmit()

    def finish(self, velocity: Vector) -> NDArray[np.float64]:
        assert self._complete.wait(1.0), "not all TPDOs came"
        values = np.empty((len(MEASURED), len(self._measured)))
        for joint, row in enumerate(self._measured):
            for k, (variable, gain, bias) in enumerate(row):
                values[k, joint] = gain * variable.raw + bias
        enabled = [word.raw & 0x6F == OPERATION_ENABLED for word in self._statuswords]
        for joint, (controlword, target, gain, bias) in enumerate(self._targets):
            controlword.raw = ENABLE_OPERATION
            target.raw = round((velocity[joint] - bias) / gain) if enabled[joint] else 0
        for pdo in self._rpdos:
            pdo.transmit()
        return values

    def close(self) -> None:
        """End the thread."""
        self._notifier.stop()


class FarEnd:
    """The drives' side of the bus: frames made beforehand, answers kept."""

    def __init__(self, bus: can.BusABC, setups: list[DriveSetup]) -> None:
        self._bus = bus
        self._pdos = [p for s in setups for p in transmit_pdos(s.drive)]
        self.cpu_s = 0.0

    def answer(self, exchange: int) -> None:
        """Take the SYNC, send all TPDOs; its CPU time is kept apart."""
        begun = time.thread_time()
        assert self._bus.recv(1.0) is not None
        for k, pdo in enumerate(self._pdos):
            counts = [
                100 * k + exchange % 1000 + i if field.entry in MOVING else OPERATION_ENABLED
                for i, field in enumerate(pdo.fields)
            ]
            data = pdo.layout.pack(*counts)
            self._bus.send(can.Message(arbitration_id=pdo.cob_id, data=data, is_extended_id=False))
        self.cpu_s += time.thread_time() - begun

    def setpoints(self) -> list[tuple[int, bytes]]:
        """RPDOs of this exchange; its CPU time is kept apart."""
        begun = time.thread_time()
        got = []
        while (message := self._bus.recv(0.0)) is not None:
            if message.arbitration_id > 0x180:
                got.append((message.arbitration_id, bytes(message.data)))
        self.cpu_s += time.thread_time() - begun
        return got


@contextmanager
def both_ends() -> Iterator[tuple[VirtualBus, VirtualBus]]:
    """A virtual bus of its own."""
    channel = f"bench-bus-{next(_channels)}"
    with (
        VirtualBus(channel) as near,
        VirtualBus(channel) as far,
    ):
        yield near, far


_channels = itertools.count()


def run(
    master: Master, far: FarEnd, number: int
) -> tuple[float, NDArray[np.float64], list[tuple[int, bytes]]]:
    """CPU time of the near side per exchange [s], the last values read, the last RPDOs."""
    values: NDArray[np.float64] = np.zeros(0)
    sent: list[tuple[int, bytes]] = []
    velocity = np.linspace(-0.3, 0.3, 7)
    far.cpu_s = 0.0
    begun = time.process_time()
    for exchange in range(number):
        master.request()
        far.answer(exchange)
        values = master.finish(velocity)
        sent = far.setpoints()
    near_s = time.process_time() - begun - far.cpu_s
    return near_s / number, values, sent


def compare(number: int, rounds: int) -> dict[str, Any]:
    """All sides in turns; CPU time per exchange [us] of every round."""
    robot = load_robot(ROMEO)
    setups, period_s = build_setups(robot), robot.configuration.period_s
    took: dict[str, list[float]] = {name: [] for name in SIDES}
    with (
        TemporaryDirectory(dir=SHARED_MEMORY) as rings,
        both_ends() as (a, far_a),
        both_ends() as (b, far_b),
        both_ends() as (c, far_c),
    ):
        folder = Path(rings)
        stock = Stock(c, setups)
        masters: tuple[Master, ...] = (
            Ours(QueueWire(a), setups, period_s, FrameRing(folder / "a", 10_000, time.monotonic)),
            Ours(MessageWire(b), setups, period_s, FrameRing(folder / "b", 10_000, time.monotonic)),
            stock,
        )
        ends = [FarEnd(far, setups) for far in (far_a, far_b, far_c)]
        try:
            for master, end in zip(masters, ends, strict=True):
                run(master, end, 50)
            for _ in range(rounds):
                results = [run(m, e, number) for m, e in zip(masters, ends, strict=True)]
                for name, (near_s, values, sent) in zip(SIDES, results, strict=True):
                    np.testing.assert_allclose(values, results[-1][1], rtol=1e-12, atol=1e-12)
                    assert sent == results[-1][2], "the same RPDOs"
                    took[name].append(round(1e6 * near_s, 1))
        finally:
            stock.close()
    return {"exchanges": number, "rounds": rounds, "us": took}


@click.command(help=help_of(__doc__))
@click.option("--exchanges", default=1000, show_default=True, help="Per round and side.")
@click.option("--rounds", default=9, show_default=True, help="The median of them counts.")
@click.option("--json", "as_json", is_flag=True)
def main(exchanges: int, rounds: int, as_json: bool) -> None:
    data = compare(exchanges, rounds)
    us = data["us"]
    if not as_json:
        for name, title in SIDES.items():
            click.echo(
                f"{title:36} {statistics.median(us[name]):6.1f} us of CPU per exchange "
                f"({min(us[name]):.1f} ... {max(us[name]):.1f} in {rounds} rounds of {exchanges})"
            )
    ratios = {
        name: statistics.median(s / o for s, o in zip(us["stock"], us[name], strict=True))
        for name in ("ours", "own_calls")
    }
    data["ratios"] = {name: round(ratio, 2) for name, ratio in ratios.items()}
    targets = [Target("CPU of an exchange, stock over ours", ratios["ours"], 3, "x", "higher")]
    print_report("bus", 0, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
