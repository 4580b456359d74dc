"""Watch on the heartbeat of one drive (CiA 301) and the NMT state in it. Time is an argument."""

from dataclasses import dataclass

from drivers.api import Kind
from drivers.canopen.events import Fact
from drivers.canopen.ids import BOOT_UP, OPERATIONAL


@dataclass(slots=True)
class HeartbeatWatch:
    """Detector of a lost heartbeat and of a drive that leaves NMT operational; reports each once.

    Create it when the drive has just been commanded operational, at `heard_at`.
    """

    node: int
    timeout_s: float
    heard_at: float
    lost: bool = False
    # Heartbeats from before NMT start may arrive after it: leaving operational is reported only
    # after operational was received.
    operational: bool = False
    # The drive has left NMT operational or restarted: its set-up is lost.
    forgot: bool = False

    def restart(self, now: float) -> None:
        """Restart the timeout at `now`: the bus was not read until then."""
        self.heard_at = now

    def on_heartbeat(self, nmt_state: int, now: float) -> Fact | None:
        """Take a heartbeat or boot-up message."""
        self.heard_at, self.lost = now, False
        state = nmt_state & 0x7F  # bit 7 is the toggle bit of node guarding
        if state == BOOT_UP:
            self.operational, self.forgot = False, True
            return Fact(Kind.RESTARTED, (self.node,), "its set-up is lost")
        was_operational, self.operational = self.operational, state == OPERATIONAL
        if self.operational or not was_operational:
            return None
        self.forgot = True
        # 127 is pre-operational, 4 is stopped: PDOs are disabled.
        text = f"no longer operational (NMT state {state})"
        return Fact(Kind.DROPPED, (self.node,), text)

    def check(self, now: float) -> Fact | None:
        """Event, once, for a heartbeat that has just become overdue."""
        if self.lost or now - self.heard_at <= self.timeout_s:
            return None
        self.lost = True
        return Fact(Kind.SILENT, (self.node,))
