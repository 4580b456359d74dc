"""Faults of the bus: frames lost, late or another node's, and failing adapters."""

import errno
from collections.abc import Iterator
from itertools import repeat

import can

from bench.rigs.breakable_arm import BreakableArm, Fault, for_ever, once, throughout
from bench.rigs.drive_faults import emergency
from bench.rigs.speech import MASTER_SILENT
from daemon.config.schema import frames_of
from drivers.api import Kind
from drivers.can.load import bus_load
from drivers.canopen.inbox import FRAMES_PER_PASS

SHORTEST_FRAME = 111  # bits: eight bytes, no stuff bit, and the gap to the next frame


one_pdo_missing = throughout(lambda on: on.losing(on.answers(on.drive)[-1]), 1)
pdos_stale = throughout(lambda on: on.losing(*on.answers(on.drive)))


def pdos_lost_in_turn(on: BreakableArm) -> Iterator[None]:
    """Never a tick with all drives, never two in a row without the same one."""
    for _ in range(30):
        for drive in on.drives[:2]:
            with on.losing(on.answers(drive)[0]):
                yield


def pdos_lost_in_most_ticks(on: BreakableArm) -> Iterator[None]:
    """Two of three, never three in a row."""
    while True:
        with on.losing(on.answers(on.drive)[0]):
            yield
            yield
        yield


def deaf_on_a_late_machine(on: BreakableArm) -> Iterator[None]:
    """Never three samples of the drive in a row are missing, but ticks are, beside them."""
    for _ in range(3):
        with on.losing(*on.answers(on.drive)):
            with on.late(0.022):
                yield
            yield
        yield


def pdos_stale_on_a_late_machine(on: BreakableArm) -> Iterator[None]:
    with on.losing(*on.answers(on.drive)), on.late(0.012):
        for _ in range(4):
            yield


def answers_a_period_late(on: BreakableArm) -> Iterator[None]:
    """Each answer comes while that to the next SYNC is awaited; at last they are in time again."""
    on.rig.drives.start(on.rig.time_s, [])  # no SYNC was left out lately
    old = on.rig.drives.samples
    with on.delaying(*on.answers(on.drive)):
        while not any(event.kind is Kind.OLD_SAMPLES for event in old.events):
            yield
            old = on.rig.drives.samples
        yield from repeat(None, 10)
    yield from repeat(None, 110)


# Another drive with the same node number answers every SYNC, too.
two_drives = throughout(lambda on: on.doubling(*on.answers(on.drive)))


def flood(on: BreakableArm) -> None:
    """Frames of a foreign broken device, so many that the arm's own have just room left."""
    c = on.rig.robot.configuration
    free = 0.95 - bus_load(frames_of(c), c.bus.bitrate)
    for _ in range(round(free * c.bus.bitrate * on.period_s / SHORTEST_FRAME)):
        on.say(0x123, bytes(8))


def flooded(on: BreakableArm) -> Iterator[None]:
    for _ in range(20):
        flood(on)
        yield


def flooded_and_unheard(on: BreakableArm) -> Iterator[None]:
    """A drive misses our heartbeat for it, and says when that is over."""
    for _ in range(12):
        flood(on)
        yield
    flood(on)
    yield from emergency(MASTER_SILENT)(on)


def foreign(what: int) -> Fault:
    """Another master's request, command or setpoint."""

    def say(on: BreakableArm) -> None:
        can_id, data = on.make.speech.foreign(on.drive)[what]
        on.say(can_id, bytes(data))

    return once(say)


foreign_request, foreign_command, foreign_setpoint = map(foreign, range(3))
one_enobufs = throughout(lambda on: on.raising(on.rig.line.full), 1)
enobufs = throughout(lambda on: on.raising(on.rig.line.full), 5)


def bus_down(on: BreakableArm) -> Iterator[None]:
    down = can.CanOperationError("Error receiving: Network is down", errno.ENETDOWN)
    with on.raising(down, down):
        yield from repeat(None, 20)


def old_frames(on: BreakableArm) -> Iterator[None]:
    """The bus returns with more old answers of every drive than one pass reads."""
    answers = [can_id for drive in on.drives for can_id in on.answers(drive)]
    for _ in range(4):
        for _ in range(FRAMES_PER_PASS // len(answers) + 14):
            for can_id in answers:
                on.say(can_id, bytes(8))
        yield


error_passive = once(lambda on: on.say(0x004, b"\0\x20\0\0\0\0\0\0", error=True))


def bus_off(on: BreakableArm) -> Iterator[None]:
    on.say(0x040, bytes(8), error=True)
    with on.raising(on.rig.line.full):
        yield


# No drive hears our SYNC, or requests, any more; everything else they hear.
sync_lost = throughout(lambda on: on.not_sending(on.make.speech.request))


def bus_off_for(seconds: float) -> Fault:
    """Our controller leaves the bus, and comes back after a while with what was queued."""

    def fault(on: BreakableArm) -> Iterator[None]:
        on.say(0x040, bytes(8), error=True)
        yield from unheard_for(seconds)(on)

    return fault


def unheard_for(seconds: float) -> Fault:
    """Nothing of ours gets onto the bus for a while, unnoticed; what was queued goes out then."""

    def fault(on: BreakableArm) -> Iterator[None]:
        with on.off_the_bus():
            for _ in range(round(seconds / on.period_s)):
                yield

    return fault


def adapter_gone(on: BreakableArm) -> Iterator[None]:
    if on.rig.line.unplug is not None:
        on.rig.line.unplug()
        yield from for_ever()
    gone = OSError(errno.ENODEV, "No such device")
    with on.raising(gone, gone):
        yield from for_ever()
