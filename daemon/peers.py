"""Who is at the other end of a connection, as the kernel tells it."""

import socket
import struct
from dataclasses import dataclass

_UCRED = struct.Struct("3i")  # pid, uid, gid
_SO_PEERGROUPS = 59  # Linux 4.13; not in Python's socket module
_MOST_GROUPS = 256


@dataclass(frozen=True, slots=True)
class Peer:
    """Who is at the other end of a connection, as the kernel saw it connect."""

    uid: int
    pid: int
    connection: int = 0  # counts up: no two connections of one daemon have the same


def peer_of(connected: socket.socket, connection: int = 0) -> Peer:
    """Credentials of the process at the other end, from the kernel."""
    raw = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
    pid, uid, _ = _UCRED.unpack(raw)
    return Peer(uid, pid, connection)


def groups_of(connected: socket.socket) -> tuple[int, ...]:
    """All groups of the process at the other end, from the kernel."""
    gid = _UCRED.unpack(connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size))[2]
    raw = connected.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, 4 * _MOST_GROUPS)
    return (gid, *struct.unpack(f"{len(raw) // 4}I", raw))
