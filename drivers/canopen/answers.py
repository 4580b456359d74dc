"""Answers of the drives to SYNC: received TPDOs, and the samples decoded from them."""

from collections.abc import Callable, Sequence

from drivers.api import DriveStatus, Event, Kind, Samples
from drivers.awaited import Awaited, Freshness
from drivers.canopen.cia402 import DriveState, drive_state, drive_status
from drivers.canopen.codec import SampleDecoder
from drivers.canopen.events import Fact
from drivers.canopen.ids import NODE
from drivers.canopen.settings import CanopenDrive


class Answers:
    """Receiver of TPDOs that produces the samples of each tick."""

    def __init__(
        self, drives: Sequence[CanopenDrive], report: Callable[[Fact], None], period_s: float
    ) -> None:
        """Raises ConfigurationError if a PDO layout does not fit."""
        self._report = report
        self.late_frames = 0
        """Number of TPDOs that were not awaited when they arrived."""
        self._nodes = tuple(drive.node for drive in drives)
        self._decoder = SampleDecoder(drives)
        self._raw = self._decoder.raw
        slots = self._decoder.slots
        self._tpdos = {
            cob_id: (1 << bit, start, stop, layout)
            for bit, (cob_id, (_, start, stop, layout)) in enumerate(slots.items())
        }
        joint_bits = [0] * len(drives)
        for bit, (joint, *_) in enumerate(slots.values()):
            joint_bits[joint] |= 1 << bit
        self.awaited = Awaited(joint_bits, period_s)
        self.punctuality = self.awaited.punctuality
        self._statuswords: tuple[int, ...] = ()
        self.states: tuple[DriveState, ...] = ()
        """States encoded in the last statuswords."""
        self._drives: tuple[DriveStatus, ...] = ()  # the same for the daemon
        self.samples = self._samples(self.awaited.freshness, ())
        """Samples of the last tick; NaN and unknown states before the first."""

    def _nodes_of(self, tpdos: int) -> tuple[int, ...]:
        return tuple(self._nodes[i] for i in self.awaited.joints_of(tpdos))

    def judge(self) -> None:
        """Report drives that answer twice or a period late, as counted by `punctuality`."""
        found = self.punctuality
        if found.twice:
            text = "two drives answer as this node"
            self._report(Fact(Kind.TWO_DRIVES, self._nodes_of(found.twice), text))
        if found.old:
            text = "it answers when no SYNC is sent"
            self._report(Fact(Kind.OLD_SAMPLES, self._nodes_of(found.old), text))

    def take(self, cob_id: int, data: bytes | bytearray) -> bool:
        """Store a frame if it is a TPDO of these drives; otherwise return False."""
        slot = self._tpdos.get(cob_id)
        if slot is None:
            return False
        bit, start, stop, layout = slot
        if len(data) < layout.size:
            return True
        self._raw[start:stop] = layout.unpack_from(data)
        if not self.awaited.take(bit):
            self.late_frames += 1
            if self.punctuality.unawaited(bit):
                text = "answers more than a period late"
                self._report(Fact(Kind.DISTURBED, (cob_id & NODE,), text))
        return True

    def finish(self, events: tuple[Event, ...]) -> Samples:
        """End the tick: decode the frames received so far into samples, with `events`."""
        self._decoder.decode()
        self.samples = self._samples(self.awaited.finish(), events)
        return self.samples

    def _samples(self, found: Freshness, events: tuple[Event, ...]) -> Samples:
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
            fresh=found.fresh,
            age_s=found.age_s,
            starting=found.starting,
            drives=self._drives,
            events=events,
        )
