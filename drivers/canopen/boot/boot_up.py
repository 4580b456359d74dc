"""Boot-up by SDO before NMT operational: each drive is identified, set up and read back.

One sequence of steps (`steps.py`), each with its own timeout and retries. Nothing is reset except
the communication of a drive in fault, which has no torque and so supports no load: some drives
clear the loss of their master (0x8130) only by this reset.
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
from drivers.canopen.boot.identity import DriveIdentity
from drivers.canopen.boot.received_frames import ReceivedFrames
from drivers.canopen.boot.required_objects import DriveSetup, check_drive, lacks, required_values
from drivers.canopen.boot.sdo import ObjectAccess
from drivers.canopen.boot.sdo_network import sdo_network
from drivers.canopen.boot.steps import SET_UP, TOGETHER, WAKE, BootingDrive, Step
from drivers.canopen.boot.verification import all_required, deviations
from drivers.canopen.ids import HEARTBEAT, OPERATIONAL, SYNC

Progress = Callable[[str], None]
Meanwhile = Callable[[], None]

LISTEN_S: Final = 0.15
TRIES: Final = 3
#: Timeout of a step, in SDO timeouts, even if every request is answered; also the longest boot time
#: after a communication reset.
STEP_TIMEOUTS: Final = 6
#: Share of the SDO timeout during a reset, in which an operator waits and no tick runs.
AGAIN_SHARE: Final = 0.3
#: Heartbeats of the master per shortest master timeout of the drives.
BEATS: Final = 6


@dataclass(slots=True)
class DriveBoot:
    """All drives of one arm, in the order of its joints: set up at the start and again after a
    fault, released at the end."""

    wire: Wire
    """shared with the tick"""
    setups: Sequence[DriveSetup]
    period_ms: int
    master_node: int = 127
    ring: FrameRing | None = None
    """records the frames"""
    listen_s: float = LISTEN_S
    """time to listen for another master before the start"""
    sleep: Callable[[float], None] = time.sleep
    """waits between two polls of a drive"""
    identities: tuple[DriveIdentity, ...] = ()
    """of the drives that were set up at the start"""
    received: ReceivedFrames = field(default_factory=ReceivedFrames)
    """frames received while drives were verified or set up again"""

    def boot_up(self, progress: Progress = lambda line: None) -> None:
        """Set up all drives, read the settings back, and leave them pre-operational; `progress`
        receives lines of text.

        Raises ConfigurationError (the EDS contradicts the configuration; nothing is sent), BusError
        (the bus fails, or another master is on it) or DriveError (a drive does not answer, is not
        the configured one, or refuses or does not keep a value).
        """
        for setup in self.setups:
            check_drive(setup, self.period_ms, self.master_node)
        refuse_other_master(self.wire, self.master_node, self.listen_s)
        with sdo_network(self.wire, self.ring) as network:
            self.identities = self._bring_up(network, self.setups, progress)

    def verify(
        self, joints: Sequence[int], meanwhile: Meanwhile = lambda: None
    ) -> dict[int, list[str]]:
        """Read the required objects of the drives of some joints without writing; returns the
        deviations, as text, of each drive that has any.

        To be called while the arm stands and no tick runs, as `renew`. A drive that does not answer
        counts as deviating. Raises BusError.
        """
        found: dict[int, list[str]] = {}
        with sdo_network(self.wire, self.ring, self.received) as network:
            beat = self._beat(network, meanwhile)
            for i in joints:
                setup = self.setups[i]
                timeout_s = AGAIN_SHARE * setup.drive.profile.sdo_timeout_ms / 1000.0
                access = self._access(network, setup, timeout_s, beat)
                rows = all_required(setup, self.period_ms, self.master_node)
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
        """Set up the drives of some joints again, while the arm stands and no tick runs, and keep
        sending the master's heartbeat to the others.

        The sequence itself sends the heartbeat and calls `meanwhile` while it waits for answers, so
        that the heartbeat ends if it hangs. A drive that does not answer ends it within two of its
        timeouts. Raises BusError or DriveError, the latter also if another drive answers than at
        the start, since the checks made then do not apply to it.
        """
        begun = time.monotonic()
        chosen = [self.setups[i] for i in joints]
        with sdo_network(self.wire, self.ring, self.received) as network:
            beat = self._beat(network, meanwhile)
            found = self._bring_up(network, chosen, progress, AGAIN_SHARE, beat)
        for i, identity in zip(joints, found, strict=True):
            if self.identities and identity != self.identities[i]:
                raise DriveError(
                    f"{self.setups[i].drive.name} has another drive than at the start: {identity}; "
                    f"it was {self.identities[i]}. To accept it, use `contactctl reload` with the "
                    "drives off, or restart the daemon after a fault"
                )
        names = ", ".join(setup.drive.name for setup in chosen)
        took_ms = 1000.0 * (time.monotonic() - begun)
        progress(f"set up again in {took_ms:.0f} ms without a tick: {names}")

    def _beat(self, network: canopen.Network, meanwhile: Meanwhile) -> "_Beat":
        timeout_s = min(setup.drive.profile.master_timeout_ms for setup in self.setups) / 1000.0
        return _Beat(network, self.master_node, timeout_s / BEATS, meanwhile)

    def disable_monitoring(self) -> None:
        """Disable the drives' monitoring of the master's heartbeat (0x1016:1 = 0) after the last
        tick.

        For drives that are off or hold in quick stop, so that the end of the heartbeat is no fault.
        All drives are written; then the first DriveError is raised, if any."""
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
        """Run all steps. share: SDO timeout, as a share of the configured one."""
        drives = []
        for setup in setups:
            timeout_s = setup.drive.profile.sdo_timeout_ms / 1000.0
            access = self._access(network, setup, share * timeout_s, meanwhile)
            rows = required_values(setup, self.period_ms, self.master_node)
            booted = _listen_for_boot_up(network, setup.drive.node)
            step_timeout_s = STEP_TIMEOUTS * timeout_s
            drives.append(
                BootingDrive(setup, access, rows, step_timeout_s, booted, meanwhile, self.sleep)
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
    """Listen for frames that only a master sends. Raises BusError if there are any."""
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
    """Run the steps of one drive, and report their duration."""
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
    """Run one step, repeated if the drive is silent; errors contain its name."""
    for tries in range(1, TRIES + 1):
        drive.access.deadline = time.monotonic() + drive.step_timeout_s
        try:
            if tries > 1:
                drive.access.settle()
                # A drive that another master has NMT-stopped answers no SDO.
                WAKE.run(drive)
            step.run(drive)
        except SilentDriveError as error:
            if tries == TRIES:
                raise SilentDriveError(
                    f"{error}; step `{step.name}`, tried {TRIES} times"
                ) from error
            drive.remarks.append(f"step `{step.name}` was repeated: {error}")
        except DriveError as error:
            raise DriveError(f"{error}; step `{step.name}`") from error
        else:
            return


class _Beat:
    """Heartbeat of the master during a wait, with a call of `meanwhile`."""

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

    def on_heartbeat(_: int, data: bytearray, __: float) -> None:
        if data[:1] == b"\0":
            booted.set()

    network.subscribe(HEARTBEAT + node, on_heartbeat)
    return booted
