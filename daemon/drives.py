"""The arm's drives by SDO, outside the tick: set up at the start, again after a fault, let go."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import can

from drivers.boot_up import boot_up, boot_up_again, forget_master
from drivers.drive_setup import DriveSetup
from drivers.frame_ring import FrameRing
from drivers.identity import DriveIdentity
from errors import DriveError

_log = logging.getLogger("contactd")


@dataclass(slots=True)
class Drives:
    """All drives of one arm, in the order of its joints."""

    bus: can.BusABC
    setups: Sequence[DriveSetup]
    period_ms: int
    master_node: int
    identities: list[DriveIdentity] = field(default_factory=list)
    ring: FrameRing | None = None  # keeps the frames

    def boot_up(self, progress: Callable[[str], None]) -> None:
        """Set all of them up and read back. Raises ContactdError."""
        found = boot_up(
            self.bus,
            self.setups,
            period_ms=self.period_ms,
            master_node=self.master_node,
            progress=progress,
            ring=self.ring,
        )
        self.identities[:] = found

    def renew(self, joints: Sequence[int], meanwhile: Callable[[], None]) -> None:
        """Set some up again, while the arm stands and nobody ticks; `meanwhile` is called all the
        time. Raises ContactdError, also when another drive answers than before: what was judged of
        the arm at the start was not of it."""
        begun = time.monotonic()
        found = boot_up_again(
            self.bus,
            self.setups,
            joints,
            period_ms=self.period_ms,
            master_node=self.master_node,
            progress=_log.info,
            meanwhile=meanwhile,
            ring=self.ring,
        )
        for i, identity in zip(joints, found, strict=True):
            if self.identities and identity != self.identities[i]:
                raise DriveError(
                    f"{self.setups[i].name} has another drive than at the start: {identity}; it "
                    f"was {self.identities[i]}. Start the daemon again"
                )
        names = ", ".join(self.setups[i].name for i in joints)
        took_ms = 1000.0 * (time.monotonic() - begun)
        _log.info("set up again in %.0f ms without a tick: %s", took_ms, names)

    def let_go(self) -> None:
        """Have them mind our silence no more. Raises DriveError when one does not hear it."""
        forget_master(self.bus, self.setups, ring=self.ring)
