"""RPDOs of all drives: controlwords and target velocities, packed into preallocated frames."""

import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from operator import itemgetter

from common.arrays import Vector
from drivers.api import PowerTarget
from drivers.can.wire import Frame
from drivers.canopen.cia402 import QUICK_STOP, DriveState, controlword
from drivers.canopen.codec import SetpointEncoder, receive_pdos
from drivers.canopen.settings import CanopenDrive


@dataclass(frozen=True, slots=True)
class _Rpdo:
    """RPDO with its reused data buffer, and the selection of (controlword, counts) it carries."""

    data: bytearray
    layout: struct.Struct
    picked: Callable[[tuple[int, int]], tuple[int, ...]]


def _picker(picks: tuple[int, ...]) -> Callable[[tuple[int, int]], tuple[int, ...]]:
    """Selector of the values in an RPDO; for a single one, a slice makes `itemgetter` return a
    tuple, too."""
    if len(picks) == 1:
        return itemgetter(slice(picks[0], picks[0] + 1))
    return itemgetter(*picks)


class Setpoints:
    """Setpoints of all drives as RPDOs; `frames` always holds the last `write`."""

    def __init__(self, drives: Sequence[CanopenDrive]) -> None:
        """Raises ConfigurationError if a PDO layout does not fit."""
        self._encoder = SetpointEncoder(drives)
        self._controlwords = [0] * len(drives)
        self._rpdos: list[list[_Rpdo]] = []
        self._frames: list[list[Frame]] = []  # per joint, as `_quick_stops`
        self._quick_stops: list[list[Frame]] = []
        for drive, still in zip(drives, self._encoder.standstill, strict=True):
            self._rpdos.append([])
            self._frames.append([])
            self._quick_stops.append([])
            for pdo in receive_pdos(drive):
                picks = tuple(0 if part.entry == "controlword" else 1 for part in pdo.fields)
                rpdo = _Rpdo(bytearray(pdo.layout.size), pdo.layout, _picker(picks))
                self._rpdos[-1].append(rpdo)
                self._frames[-1].append((pdo.cob_id, rpdo.data))
                stop = pdo.layout.pack(*((QUICK_STOP, still)[pick] for pick in picks))
                self._quick_stops[-1].append((pdo.cob_id, stop))
        self.address(range(len(drives)))

    def address(self, joints: Iterable[int]) -> None:
        """Restrict the frames to the drives of these joints: one that is not set up may interpret
        them differently."""
        chosen = sorted(joints)
        self.frames = [frame for i in chosen for frame in self._frames[i]]
        self.quick_stops = [frame for i in chosen for frame in self._quick_stops[i]]
        """Frames that stop each drive in any state, packed in advance so that no later failure can
        prevent them."""

    def write(
        self,
        states: Sequence[DriveState],
        targets: Sequence[PowerTarget],
        velocity: Vector,
        reset: bool,
    ) -> None:
        """Pack the next controlword of each drive towards its target, and its velocity: zero unless
        it is in operation and its target is ON.

        velocity: (n,) rad/s at the link; if one is not finite, all drives get a quick stop instead,
        and ValueError is raised.
        """
        standstill = self._encoder.standstill
        try:
            counts, error = self._encoder.encode(velocity), None
        except ValueError as raised:
            counts, error = standstill, raised
            targets = [PowerTarget.QUICK_STOP] * len(targets)
        for i, rpdos in enumerate(self._rpdos):
            target, state = targets[i], states[i]
            moves = target is PowerTarget.ON and state is DriveState.OPERATION_ENABLED
            word = controlword(state, target, self._controlwords[i], reset)
            self._controlwords[i] = word
            values = (word, counts[i] if moves else standstill[i])
            for rpdo in rpdos:
                rpdo.layout.pack_into(rpdo.data, 0, *rpdo.picked(values))
        if error:
            raise error
