"""RPDOs of all drives: controlwords and target velocities, written into frames that stay."""

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
    """Its data, written over and over, and which of (controlword, counts) it carries."""

    data: bytearray
    layout: struct.Struct
    picked: Callable[[tuple[int, int]], tuple[int, ...]]


def _picker(picks: tuple[int, ...]) -> Callable[[tuple[int, int]], tuple[int, ...]]:
    """Function that takes what an RPDO carries; `itemgetter` of one alone makes no tuple."""
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
        self._frames: list[list[Frame]] = []  # of each joint, like the next
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
        """Let frames go to the drives of these joints alone: one that is not set up may take them
        for something else."""
        chosen = sorted(joints)
        self.frames = [frame for i in chosen for frame in self._frames[i]]
        self.quick_stops = [frame for i in chosen for frame in self._quick_stops[i]]
        """Stop each drive in any state; ready beforehand, so that nothing that breaks can be in
        their way."""

    def write(
        self,
        states: Sequence[DriveState],
        targets: Sequence[PowerTarget],
        velocity: Vector,
        reset: bool,
    ) -> None:
        """Take each drive on its way to its target. One that is not in operation, or not wanted
        there, gets velocity zero.

        velocity: (n,) rad/s at the link; where one is not finite, all drives get a quick stop
        instead, and ValueError is raised.
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
