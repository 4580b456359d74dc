"""Arming lease: granted, renewed and ended."""

from collections.abc import Sequence
from dataclasses import dataclass

from daemon.arming.checks import ArmingChecks
from daemon.protocol.lease import PERSON_S, PROGRAM_S, Lease, Owner, in_words
from daemon.protocol.replies import Check
from daemon.protocol.requests import Arm, Renew, Request
from daemon.protocol.socket_path import Peer
from daemon.protocol.state import Permit
from daemon.tick.tick import Tick


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to `arm` or `renew`: reasons of a refusal, duration [s], and all checks of `arm`."""

    reasons: Sequence[str]
    duration_s: float
    checks: Sequence[Check] = ()


def owner_of(request: Request, peer: Peer, connection: int = 0) -> Owner:
    """Owner for a request: process credentials from the kernel, and the name that it states."""
    return Owner(peer.uid, peer.pid, connection, request.on_behalf_of or "")


@dataclass(slots=True)
class Permission:
    """Permission to yield to contact: one lease at a time, which ends when it expires or when its
    owner's connection is closed."""

    tick: Tick
    checks: ArmingChecks
    lease: Lease | None = None

    @property
    def connection(self) -> int:
        """Number of the connection that holds the lease; 0 if it is detached, or there is none."""
        return self.lease.owner.connection if self.lease else 0

    def arm(self, request: Arm, peer: Peer, time_s: float) -> Answer:
        """Arm an arm that is not armed. A person extends a lease with another `arm`, a program with
        `renew`."""
        owner = owner_of(request, peer, 0 if request.detached else peer.connection)
        duration_s = request.lease_s or (PERSON_S if request.detached else PROGRAM_S)
        held = self._held(time_s)
        if held is not None:
            refusal = held.refusal(owner, time_s)
            if not refusal and owner.connection:
                refusal = "this connection has armed it already: use `renew`"
            return self._grant(owner, duration_s, time_s, [refusal] if refusal else [])
        found = self.checks.run(time_s)
        reasons = found.reasons or self.tick.controller.arm(f"{owner}, for {in_words(duration_s)}")
        return self._grant(owner, duration_s, time_s, reasons, found.checks)

    def renew(self, request: Renew, peer: Peer, time_s: float) -> Answer:
        """Extend the lease of this connection. Never arms: a program that renews periodically must
        not undo another client's `disarm`, or a fault."""
        owner = owner_of(request, peer, peer.connection)
        held = self._held(time_s)
        refusal = held.refusal(owner, time_s) if held else "not armed any more: `arm` it anew"
        duration_s = request.lease_s or PROGRAM_S
        return self._grant(owner, duration_s, time_s, [refusal] if refusal else [])

    def _held(self, time_s: float) -> Lease | None:
        # A lease that has expired since the last tick has no owner any more.
        self.expire(time_s)
        return self.lease if self.tick.controller.machine.armed else None

    def _grant(
        self,
        owner: Owner,
        duration_s: float,
        time_s: float,
        reasons: Sequence[str],
        checks: Sequence[Check] = (),
    ) -> Answer:
        if not reasons:
            self.lease = Lease(owner, time_s + duration_s)
        return Answer(reasons, duration_s, checks)

    def expire(self, time_s: float, closed: int = 0) -> None:
        """End the lease if it has expired, or was held by connection number `closed`."""
        lease, controller = self.lease, self.tick.controller
        if lease is None:
            return
        if not controller.machine.armed:
            self.lease = None
        elif why := lease.ended(time_s, closed):
            self.lease = None
            controller.disarm(why, time_s)

    def permit(self, time_s: float) -> Permit | None:
        """Owner of the lease and the time it has left; None while the arm is not armed."""
        lease = self.lease
        if lease is None or not self.tick.controller.machine.armed:
            return None
        return Permit(
            uid=lease.owner.uid,
            pid=lease.owner.pid,
            detached=lease.owner.connection == 0,
            left_s=lease.left_s(time_s),
            on_behalf_of=lease.owner.on_behalf_of,
        )
