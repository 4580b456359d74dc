"""Answers of the drives to SYNC: TPDOs received so far, and the samples made of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from drivers.api import DriveStatus, Event, Kind, Samples
from drivers.canopen.cia402 import DriveState, drive_state, drive_status
from drivers.canopen.codec import SampleDecoder
from drivers.canopen.drive import Drive
from drivers.canopen.events import Fact
from drivers.canopen.ids import NODE
from drivers.canopen.punctuality import Punctuality

#: A drive may take so many ticks from NMT start to its first answer.
START_TICKS = 30

T = TypeVar("T", bound=np.generic)


@dataclass(slots=True)
class Counters:
    """Counters of irregular frames and failures on the bus."""

    unknown_frames: int = 0
    short_frames: int = 0
    late_frames: int = 0
    missing_frames: int = 0
    error_frames: int = 0
    send_errors: int = 0
    dropped_events: int = 0


class Answers:
    """TPDOs in, samples out. Which are still awaited is one integer, a bit for each of them."""

    def __init__(
        self,
        drives: Sequence[Drive],
        counters: Counters,
        report: Callable[[Fact], None],
        period_s: float,
    ) -> None:
        """Raises ConfigurationError if a PDO layout does not fit."""
        self._counters, self._report = counters, report
        self.punctuality = Punctuality(period_s)
        self._period_s = period_s
        self._nodes = tuple(drive.node for drive in drives)
        self._decoder = SampleDecoder(drives)
        self._raw = self._decoder.raw
        slots = self._decoder.slots
        self._tpdos = {
            cob_id: (1 << bit, start, stop, layout)
            for bit, (cob_id, (_, start, stop, layout)) in enumerate(slots.items())
        }
        self._joint_bits = [0] * len(drives)
        for bit, (joint, *_) in enumerate(slots.values()):
            self._joint_bits[joint] |= 1 << bit
        self._all = (1 << len(self._tpdos)) - 1
        self.missing = 0
        """Not zero while one is awaited."""
        self._asked = False  # by a SYNC in this tick
        n = len(drives)
        self._every = _frozen(np.ones(n, dtype=np.bool_))
        self._none = self._starting = _frozen(np.zeros(n, dtype=np.bool_))
        self._start_ticks = 0  # left, in which a drive may still be on its way to operational
        self._no_ticks = self._age_ticks = np.zeros(n, dtype=np.int64)
        self._no_age: Vector = _frozen(np.zeros(n))
        self._age_s = self._no_age
        self._statuswords: tuple[int, ...] = ()
        self.states: tuple[DriveState, ...] = ()
        """States that the last statuswords encode."""
        self._drives: tuple[DriveStatus, ...] = ()  # the same, in the words of the daemon
        self.samples = self._samples(self._none, ())
        """Samples of the last tick; before the first, NaN and unknown states."""

    def start_anew(self) -> None:
        """Start over after a time without SYNC: count the age of samples from the next tick on, and
        take no earlier frame for an answer."""
        self._age_ticks, self._age_s = self._no_ticks, self._no_age
        self.missing, self._asked = 0, False
        self.punctuality.start_anew()
        self._start_ticks, self._starting = START_TICKS, self._every

    def expect_none(self) -> None:
        """Count every frame until the next SYNC as late."""
        self.missing = 0

    def expect_all(self, now: float) -> None:
        """Await an answer of every drive: SYNC is about to go out."""
        self.punctuality.asked(now)
        self.missing, self._asked = self._all, True

    def miss_all(self) -> None:
        """Count the answers of this tick as missing: they belong to no SYNC, or not surely to this
        one."""
        self.missing = self._all

    def joints_of(self, tpdos: int) -> list[int]:
        """Joints whose drives send one of these."""
        return [i for i, bits in enumerate(self._joint_bits) if bits & tpdos]

    def _nodes_of(self, tpdos: int) -> tuple[int, ...]:
        return tuple(self._nodes[i] for i in self.joints_of(tpdos))

    def judge(self) -> None:
        """Report drives that answer twice, or a period late, by the numbers of their answers."""
        found = self.punctuality
        if found.twice:
            text = "two drives answer as this node"
            self._report(Fact(Kind.TWO_DRIVES, self._nodes_of(found.twice), text))
        if found.old:
            text = "it answers when no SYNC is sent"
            self._report(Fact(Kind.OLD_SAMPLES, self._nodes_of(found.old), text))

    def take(self, cob_id: int, data: bytes | bytearray) -> bool:
        """Keep a frame if it is a TPDO; False if it is none."""
        slot = self._tpdos.get(cob_id)
        if slot is None:
            return False
        bit, start, stop, layout = slot
        if len(data) < layout.size:
            self._counters.short_frames += 1
            return True
        self._raw[start:stop] = layout.unpack_from(data)
        if self.missing & bit:
            self.missing ^= bit
        else:
            self._counters.late_frames += 1
            if self.punctuality.unawaited(bit):
                text = "answers later than a whole period"
                self._report(Fact(Kind.DISTURBED, (cob_id & NODE,), text))
        return True

    def finish(self, events: tuple[Event, ...]) -> Samples:
        """Make the samples of this tick from the frames received so far, with `events`."""
        missing, fresh = self.missing, self._every
        if self._asked:
            self.punctuality.ended(missing)
            self._asked = False
        self._decoder.decode()
        if missing:
            self._counters.missing_frames += missing.bit_count()
            fresh = _frozen(np.array([not missing & bits for bits in self._joint_bits]))
            self._age_ticks = np.where(fresh, 0, self._age_ticks + 1)
            self._age_s = _frozen(np.multiply(self._age_ticks, self._period_s, dtype=float))
            if self._start_ticks:
                self._start_ticks -= 1
                self._starting = _frozen(self._starting & ~fresh)
            else:
                self._starting = self._none
        else:
            self._age_ticks, self._age_s = self._no_ticks, self._no_age
            self._starting, self._start_ticks = self._none, 0
        self.samples = self._samples(fresh, events)
        return self.samples

    def _samples(self, fresh: NDArray[np.bool_], events: tuple[Event, ...]) -> Samples:
        decoder = self._decoder
        if decoder.statuswords != self._statuswords:
            self._statuswords = decoder.statuswords
            self.states = tuple(map(drive_state, decoder.statuswords))
            self._drives = tuple(map(drive_status, decoder.statuswords))
        return Samples(
            current=decoder.current,
            link_position=decoder.link_position,
            motor_velocity=decoder.motor_velocity,
            motor_position=decoder.motor_position,
            fresh=fresh,
            age_s=self._age_s,
            starting=self._starting,
            drives=self._drives,
            events=events,
        )


def _frozen(array: NDArray[T]) -> NDArray[T]:
    array.setflags(write=False)
    return array
