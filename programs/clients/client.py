"""Blocking client of the control socket, with contactd's own types for its messages.

The command lines use it; it avoids slow imports, so that they start at once. The connection is that
of `contactd_client`, the client for external programs.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Self, TypeVar

import msgspec

from common.errors import ControlError, TrajectoryError
from contactd_client.connection import ANSWER_S, Connection, command_timeout_s
from contactd_client.paths import usual_socket_path
from daemon.motion.trajectory_file import refuse_shapes, rows_of, slopes
from daemon.protocol.bounds import PLAUSIBLE
from daemon.protocol.lease import LONGEST_S
from daemon.protocol.replies import Reply, Status
from daemon.protocol.requests import (
    MAX_REQUEST_BYTES,
    Arm,
    Command,
    Go,
    Header,
    Load,
    Renew,
    Request,
    SetPayload,
    Start,
    bare,
)
from daemon.protocol.state import Snapshot, State, format_refusal
from daemon.protocol.text import printable

T = TypeVar("T")


class Client:
    """One connection to the daemon, from construction to `close`.

    Raises UnreachableError if there is no daemon, this user has no permission, or there is no reply
    within `timeout_s` [s]; ControlError for a reply that cannot be decoded.
    """

    def __init__(self, path: Path | None = None, timeout_s: float = ANSWER_S) -> None:
        self.path = path or usual_socket_path()
        self._timeout_s = timeout_s
        self._connection = Connection(self.path, timeout_s)
        self._replies = msgspec.json.Decoder(Reply)
        self._states = msgspec.json.Decoder(State)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def request(self, command: Command) -> Reply:
        """Send `command` and wait for the reply, which may be a refusal."""
        return self.ask(bare(command))

    def ask(self, request: Request) -> Reply:
        """Send a request with arguments and wait for the reply, which may be a refusal."""
        timeout = command_timeout_s(request.command, self._timeout_s)
        answer = self._connection.exchange(msgspec.json.encode(request), timeout)
        return decoded(self._replies, answer)

    def demand(self, command: Command) -> Reply:
        """Send `command` and return the reply. Raises ControlError with all reasons if refused."""
        reply = self.request(command)
        if not reply.ok:
            raise ControlError(reply.refusal)
        return reply

    def ask_status(self) -> Status:
        """Status of the daemon. Raises ControlError if refused."""
        reply = self.request("status")
        if reply.status is None:
            raise ControlError(reply.refusal)
        return reply.status

    def arm(self, lease_s: float | None = None, *, detached: bool = False) -> Reply:
        """Arm the arm; the reply may be a refusal.

        The lease lasts `lease_s` [s], by default 0.5 s: `renew` it well before its end. It ends
        with this connection. `detached` is for people at a command line: the lease, by default
        600 s, outlives the connection, and any process of the same user renews it by arming again.

        Raises ControlError unless 0 < lease_s <= 86400.
        """
        return self.ask(Arm(lease_s=_a_lease(lease_s), detached=detached))

    def renew(self, lease_s: float | None = None) -> Reply:
        """Renew the lease of this connection for another `lease_s` [s], by default 0.5 s. Refused
        once the arm is disarmed. Raises ControlError unless 0 < lease_s <= 86400."""
        return self.ask(Renew(lease_s=_a_lease(lease_s)))

    def payload(
        self,
        mass: float | None = None,
        com: Sequence[float] | None = None,
        *,
        name: str = "",
        box: Sequence[float] | None = None,
    ) -> Reply:
        """Announce the payload in the hand: a `mass` [kg] with its centre of mass `com` (3,) [m] in
        the frame of the URDF's last link (by default the tool point) and edge lengths (3,) [m] of a
        `box` about it for walls; or the `name` of a configured payload; neither, or 0 kg: none. The
        reply may be a refusal."""
        place, edges = (None if x is None else list(x) for x in (com, box))
        if name or not place is edges is None:  # the daemon refuses invalid combinations
            return self.ask(SetPayload(name=name or None, mass=mass, com=place, box=edges))
        return self.ask(SetPayload(mass=mass or 0.0))

    def go(
        self,
        pose: str = "",
        targets: Mapping[str, float] | None = None,
        *,
        speed: float | None = None,
        plan: bool = False,
        planned_from: Sequence[float] | None = None,
        attended: bool = False,
    ) -> Reply:
        """Move on a straight line in joint space to a `pose` of the configuration, or to `targets`,
        positions by joint [rad]; other joints do not move. `speed` [rad/s] is that of the joint
        with the longest distance, by default 0.2. Collisions are not avoided.

        With `plan` nothing moves; the reply's `way` is the planned path. `planned_from` (n,) [rad]
        is the `way.start` of such a reply: the motion is refused if the arm is elsewhere now. A
        contact halts the arm even while it is not armed. An `attended` motion halts when this
        connection ends or sends nothing for 2 s. The reply may be a refusal.
        """
        return self.ask(
            Go(
                pose=pose or None,
                targets=dict(targets) if targets else None,
                speed=speed,
                plan=plan,
                planned_from=None if planned_from is None else list(planned_from),
                attended=attended,
            )
        )

    def load_trajectory(
        self,
        joints: Sequence[str],
        times: Sequence[float],
        positions: Sequence[Sequence[float]],
        velocities: Sequence[Sequence[float]] | None = None,
        *,
        name: str = "trajectory",
        from_here: bool = False,
        motors_only: bool = False,
    ) -> None:
        """Send a trajectory to the daemon, which checks every row against the arm's limits.

        `joints` names k joints, others hold; `times` (m,) [s] increase; `positions` and
        `velocities` (m, k) [rad, rad/s] at the link, rows of numbers or arrays; 2 <= m <= 60000.
        The samples are interpolated by a cubic Hermite spline; default velocities are the slopes
        of parabolas through neighbouring samples. The arm must be within 0.05 rad of the first row
        when it starts, unless `from_here` makes all rows displacements. With `motors_only` the
        motors run at the path's velocity without position loops over the links, so that a motor
        stands still while a hand moves its link through the gap.

        Nothing moves until `start_loaded`; the trajectory is discarded when this connection ends,
        or another one is loaded. Raises TrajectoryError, whose `row` is the first refused one.
        """
        refuse_shapes(len(joints), times, positions, velocities)
        if velocities is None:
            velocities = slopes(times, positions)
        rows = rows_of(times, positions, velocities)
        for i, numbers in enumerate(rows):
            if not all(abs(x) <= PLAUSIBLE for x in numbers):
                raise TrajectoryError(f"{numbers} must be numbers of at most {PLAUSIBLE:g}", row=i)
        header = Header(
            name=printable(name)[-64:],
            joints=list(joints),
            from_here=from_here,
            motors_only=motors_only,
        )
        self._load(Load(header=header))
        for chunk in _chunks(rows):
            self._load(Load(rows=chunk))

    def start_loaded(self, *, attended: bool = False) -> Reply:
        """Run the loaded trajectory; the reply may be a refusal. An `attended` motion halts when
        this connection ends or sends nothing for 2 s."""
        return self.ask(Start(loaded=True, attended=attended))

    def _load(self, request: Load) -> None:
        reply = self.ask(request)
        if not reply.ok:
            text = "; ".join(reply.reasons) or reply.message
            raise TrajectoryError(text, row=reply.row)

    def subscribe(self) -> tuple[Snapshot, Iterator[State]]:
        """Subscribe; returns the snapshot and an iterator over all States from then on.

        The iterator never ends: it raises UnreachableError when the daemon is gone or silent. A
        reader that is too slow misses States, which their `tick` shows.
        """
        reply = self.request("subscribe")
        if not reply.ok or reply.snapshot is None:
            raise ControlError(reply.refusal)
        if refusal := format_refusal(reply.snapshot.format):
            raise ControlError(f"the daemon has another version: its States are {refusal}")
        return reply.snapshot, self._iterate()

    def waits(self, timeout_s: float) -> bool:
        """Wait at most `timeout_s` [s]; True if a message, or the connection's end, can be read."""
        return self._connection.waits(timeout_s)

    def packet(self) -> bytes:
        """Next message as raw bytes."""
        return self._connection.packet()

    def _iterate(self) -> Iterator[State]:
        while True:
            yield decoded(self._states, self.packet())


def decoded(decoder: msgspec.json.Decoder[T], packet: bytes) -> T:
    """Message decoded from a packet of the daemon. Raises ControlError if it does not match."""
    try:
        return decoder.decode(packet)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ControlError(f"the daemon has another version: {error}") from error


def _chunks(rows: Sequence[list[float]]) -> Iterator[list[list[float]]]:
    """Rows rounded to 1e-9, below the drives' resolution, in chunks that fit into a request."""
    chunk: list[list[float]] = []
    room = limit = MAX_REQUEST_BYTES - len(msgspec.json.encode(Load(rows=[])))
    for row in rows:
        short = [round(number, 9) for number in row]
        size = len(msgspec.json.encode(short)) + 1
        if size > room:
            yield chunk
            chunk, room = [], limit
        chunk.append(short)
        room -= size
    yield chunk


def _a_lease(lease_s: float | None) -> float | None:
    if lease_s is not None and not 0.0 < lease_s <= LONGEST_S:  # nor NaN
        raise ControlError(f"lease of {lease_s} s: must be more than 0, at most {LONGEST_S:g} s")
    return lease_s
