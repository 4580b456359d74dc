"""CANopen drives of one arm over their life cycle: `drivers.api.BootableDrives`."""

from collections.abc import Callable, Sequence

from common.errors import ContactdError
from drivers.api import Report
from drivers.can.wire import Frame, Wire
from drivers.canopen.boot.boot_up import DriveBoot
from drivers.canopen.drives import CanopenDrives


class CanopenArm(CanopenDrives):
    """Drives in the tick, with their set-up by SDO before the first tick and between ticks."""

    def __init__(
        self, wire: Wire, boot: DriveBoot, period_s: float, clock: Callable[[], float], bitrate: int
    ) -> None:
        """Raises ConfigurationError if a PDO layout does not fit."""
        drives = [setup.drive for setup in boot.setups]
        super().__init__(wire, drives, period_s, clock, boot.master_node, bitrate)
        self.boot = boot

    @property
    def identities(self) -> tuple[str, ...]:
        """Make and serial number of each drive that was set up, as text."""
        return tuple(map(str, self.boot.identities))

    @property
    def serials(self) -> list[int | None]:
        """Serial number of each drive that was set up; None if it has none."""
        return [identity.serial for identity in self.boot.identities]

    def boot_up(self, report: Report) -> None:
        """Set up all drives and read the settings back, as `DriveBoot.boot_up`."""
        self.boot.boot_up(report)

    def start(
        self, now: float, renewed: Sequence[int] | None = None, received: Sequence[Frame] = ()
    ) -> None:
        """Start cyclic operation as `CanopenDrives.start`, with the frames of the boot-up."""
        super().start(now, renewed, [*self.boot.received.take(), *received])

    def prove(self, meanwhile: Callable[[], None], report: Report, warn: Report) -> list[int]:
        """Read back all drives, and set up again those that differ; returns their joints.

        Raises ContactdError. After any other exception no drive counts as set up.
        """
        try:
            if unset := self._not_set_up(meanwhile, warn):
                self.boot.renew(unset, meanwhile, report)
        except ContactdError:
            raise
        except Exception:
            self.distrust(range(len(self.names)))
            raise
        return unset

    def _not_set_up(self, meanwhile: Callable[[], None], warn: Report) -> list[int]:
        """Joints whose drives must be set up again: already known, or found by reading back."""
        known = self.unfit()
        for i in known:
            warn(f"{self.names[i]}: silent, restarted, or locked: setting it up again")
        others = [i for i in range(len(self.names)) if i not in known]
        found = self.boot.verify(others, meanwhile)
        for i, problems in found.items():
            for problem in problems:
                warn(f"{self.boot.setups[i]}: {problem}: setting it up again")
        self.distrust([*known, *found])
        return sorted([*known, *found])

    def disable_monitoring(self) -> None:
        """Disable the drives' monitoring of the master, as `DriveBoot.disable_monitoring`."""
        self.boot.disable_monitoring()
