"""Boot-up: every drive identified, set up, read back, by SDO, before NMT operational.

One sequence of steps (`steps.py`); each has a time of its own and as many tries. Nothing is reset
but the communication of a drive in fault, which has no torque and so holds nothing up: some drives
let go of the loss of their master (0x8130) only so.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import canopen

from common.errors import BusError, DriveError, SilentDriveError
from drivers.can.bus import BUS_FAILURES
from drivers.can.frame_ring import FrameRing
from drivers.can.wire import REMOTE, Wire
from drivers.canopen.boot.heard_frames import HeardFrames
from drivers.canopen.boot.identity import DriveIdentity
from drivers.canopen.boot.required_objects import DriveSetup, check_drive, lacks, wanted
from drivers.canopen.boot.sdo import ObjectAccess
from drivers.canopen.boot.sdo_network import sdo_network
from drivers.canopen.boot.steps import SET_UP, TOGETHER, WAKE, BootingDrive, Step
from drivers.canopen.boot.verification import all_wanted, deviations
from drivers.canopen.ids import HEARTBEAT, OPERATIONAL, SYNC

Progress = Callable[[str], None]
Meanwhile = Callable[[], None]

LISTEN_S: Final = 0.15
TRIES: Final = 3
#: A step that is answered, but for ever, ends after so many time-outs of one SDO; a drive whose
#: communication was reset may take as long to boot.
STEP_TIMEOUTS: Final = 6
#: During a reset a person waits and no tick runs: a drive that is gone is given up sooner.
AGAIN_SHARE: Final = 0.3
#: Beats of the master in the time that the least patient drive waits for one.
BEATS: Final = 6


@dataclass(slots=True)
class DriveBoot:
    """All drives of one arm, in the order of its joints: set up at the start, again after a fault,
    let go at the end."""

    wire: Wire
    """that of the tick"""
    setups: Sequence[DriveSetup]
    period_ms: int
    master_node: int = 127
    ring: FrameRing | None = None
    """keeps the frames"""
    listen_s: float = LISTEN_S
    """for another master, before the start"""
    sleep: Callable[[float], None] = time.sleep
    """lets time pass between two looks at a drive"""
    identities: tuple[DriveIdentity, ...] = ()
    """of the drives that were set up at the start"""
    heard: HeardFrames = field(default_factory=HeardFrames)
    """frames that came while drives were verified or set up again"""

    def boot_up(self, progress: Progress = lambda line: None) -> None:
        """Set all drives up, read back, and leave them pre-operational; `progress` gets lines of
        text.

        Raises ConfigurationError (the EDS does not have what is configured; the bus is not
        touched), BusError (the bus fails, another master is there) or DriveError (a drive does not
        answer, is another one, refuses or does not hold an object).
        """
        for setup in self.setups:
            check_drive(setup, self.period_ms, self.master_node)
        refuse_other_master(self.wire, self.master_node, self.listen_s)
        with sdo_network(self.wire, self.ring) as network:
            self.identities = self._bring_up(network, self.setups, progress)

    def verify(
        self, joints: Sequence[int], meanwhile: Meanwhile = lambda: None
    ) -> dict[int, list[str]]:
        """Read the objects that the drives of some joints must hold, and write nothing; returns the
        deviations of each drive that has any, in words.

        While the arm stands and no tick runs, as for `renew`. A drive that does not answer counts
        as deviating. Raises BusError.
        """
        found: dict[int, list[str]] = {}
        with sdo_network(self.wire, self.ring, self.heard) as network:
            beat = self._beat(network, meanwhile)
            for i in joints:
                setup = self.setups[i]
                timeout_s = AGAIN_SHARE * setup.drive.profile.sdo_timeout_ms / 1000.0
                access = self._access(network, setup, timeout_s, beat)
                rows = all_wanted(setup, self.period_ms, self.master_node)
                identity = self.identities[i] if self.identities else None
                if problems := deviations(setup, access, rows, identity):
                    found[i] = problems
        return found

    def renew(
        self,
        joints: Sequence[int],
        meanwhile: Meanwhile = lambda: None,
        progress: Progress = lambda line: None,
    ) -> None:
        """Set the drives of some joints up again, while the arm stands, no tick runs, and the
        others go on hearing their master.

        The sequence itself sends the heartbeat, and calls `meanwhile`, while it waits for answers,
        so that one that hangs falls silent. A drive that does not answer ends it within two of its
        time-outs. Raises BusError or DriveError, the latter also when another drive answers than at
        the start, as the checks made then do not hold for it.
        """
        begun = time.monotonic()
        chosen = [self.setups[i] for i in joints]
        with sdo_network(self.wire, self.ring, self.heard) as network:
            beat = self._beat(network, meanwhile)
            found = self._bring_up(network, chosen, progress, AGAIN_SHARE, beat)
        for i, identity in zip(joints, found, strict=True):
            if self.identities and identity != self.identities[i]:
                raise DriveError(
                    f"{self.setups[i].drive.name} has another drive than at the start: {identity}; "
                    f"it was {self.identities[i]}. With the drives off `contactctl reload` takes "
                    "it up, after a fault a new start of the daemon"
                )
        names = ", ".join(setup.drive.name for setup in chosen)
        took_ms = 1000.0 * (time.monotonic() - begun)
        progress(f"set up again in {took_ms:.0f} ms without a tick: {names}")

    def _beat(self, network: canopen.Network, meanwhile: Meanwhile) -> "_Beat":
        patience_s = min(setup.drive.profile.master_timeout_ms for setup in self.setups) / 1000.0
        return _Beat(network, self.master_node, patience_s / BEATS, meanwhile)

    def let_go(self) -> None:
        """End the drives' watch on the master's heartbeat (0x1016:1 = 0), after the last tick.

        For drives that are off or hold in quick stop, so that our leaving is no fault to them.
        Every drive is written; then the first DriveError is raised, if there was one.
        """
        errors = []
        with sdo_network(self.wire, self.ring) as network:
            for setup in self.setups:
                timeout_s = setup.drive.profile.sdo_timeout_ms / 1000.0
                access = self._access(network, setup, timeout_s)
                try:
                    access.write(0x1016, 1, 0)
                except DriveError as error:
                    errors.append(error)
        if errors:
            raise errors[0]

    def _access(
        self,
        network: canopen.Network,
        setup: DriveSetup,
        timeout_s: float,
        meanwhile: Meanwhile = lambda: None,
    ) -> ObjectAccess:
        return ObjectAccess(network, setup, timeout_s, meanwhile)

    def _bring_up(
        self,
        network: canopen.Network,
        setups: Sequence[DriveSetup],
        progress: Progress,
        share: float = 1.0,
        meanwhile: Meanwhile = lambda: None,
    ) -> tuple[DriveIdentity, ...]:
        """`share` of the configured time-out is that of one SDO."""
        drives = []
        for setup in setups:
            timeout_s = setup.drive.profile.sdo_timeout_ms / 1000.0
            access = self._access(network, setup, share * timeout_s, meanwhile)
            rows = wanted(setup, self.period_ms, self.master_node)
            booted = _listen_for_boot_up(network, setup.drive.node)
            patience_s = STEP_TIMEOUTS * timeout_s
            drives.append(
                BootingDrive(setup, access, rows, patience_s, booted, meanwhile, self.sleep)
            )
        for step in TOGETHER:
            for drive in drives:
                _run(step, drive)
        for drive in drives:
            progress(f"{drive.setup}: {drive.identity}")
        for name, setup in {each.drive.wiring.profile: each for each in setups}.items():
            for remark in lacks(setup, self.period_ms, self.master_node):
                progress(f"drive profile {name}: {remark}")
        for drive in drives:
            _set_up(drive, progress)
        for drive in drives:
            if drive.booted.is_set():
                raise DriveError(f"{drive.setup} restarted while the drives were set up")
        return tuple(drive.identity for drive in drives if drive.identity is not None)


def refuse_other_master(wire: Wire, master_node: int, listen_s: float) -> None:
    """Listen for frames that only a master sends; raises BusError if there are any."""
    deadline = time.monotonic() + listen_s
    while (remaining := deadline - time.monotonic()) > 0.0:
        try:
            frame = wire.receive(remaining)
        except BUS_FAILURES as error:
            raise BusError(f"the bus cannot be read: {error}") from error
        if frame is None:
            continue
        can_id = frame[0] & ~REMOTE
        if can_id == HEARTBEAT + master_node:
            raise BusError(f"another master (node {master_node}) is on this bus")
        if can_id == SYNC:
            raise BusError("another master is on this bus: SYNC is being sent")


# --- the sequence -----------------------------------------------------------------------------


def _set_up(drive: BootingDrive, progress: Progress) -> None:
    """The steps of one drive after the other's, and how long they took."""
    begun = time.monotonic()
    drive.booted.clear()
    for step in SET_UP:
        _run(step, drive)
    for remark in drive.remarks:
        progress(f"{drive.setup}: {remark}")
    took_ms = 1000.0 * (time.monotonic() - begun)
    names = ", ".join(step.name for step in SET_UP)
    progress(f"{drive.setup}: set up and read back in {took_ms:.0f} ms ({names})")


def _run(step: Step, drive: BootingDrive) -> None:
    """Do one step, again if the drive was silent; its name goes into every error."""
    for tries in range(1, TRIES + 1):
        drive.access.deadline = time.monotonic() + drive.patience_s
        try:
            if tries > 1:
                drive.access.settle()
                # A drive that another node has stopped answers no SDO.
                WAKE.run(drive)
            step.run(drive)
        except SilentDriveError as error:
            if tries == TRIES:
                raise SilentDriveError(
                    f"{error}; step `{step.name}`, tried {TRIES} times"
                ) from error
            drive.remarks.append(f"step `{step.name}` was done again: {error}")
        except DriveError as error:
            raise DriveError(f"{error}; step `{step.name}`") from error
        else:
            return


class _Beat:
    """Heartbeat of the master during a wait, and whatever else must not fall silent."""

    def __init__(
        self, network: canopen.Network, master_node: int, every_s: float, meanwhile: Meanwhile
    ) -> None:
        self._network, self._cob_id, self._every_s = network, HEARTBEAT + master_node, every_s
        self._meanwhile = meanwhile
        self._next_s = 0.0

    def __call__(self) -> None:
        now = time.monotonic()
        if now >= self._next_s:
            self._next_s = now + self._every_s
            try:
                self._network.send_message(self._cob_id, [OPERATIONAL])
            except BUS_FAILURES as error:
                raise BusError(f"the master's heartbeat: {error}") from error
            self._meanwhile()


def _listen_for_boot_up(network: canopen.Network, node: int) -> threading.Event:
    booted = threading.Event()

    def hear(_: int, data: bytearray, __: float) -> None:
        if data[:1] == b"\0":
            booted.set()

    network.subscribe(HEARTBEAT + node, hear)
    return booted
