"""File of a socket that the daemon listens at: its permissions, and the credentials of its peers.

The file's group decides who may connect; the kernel reports the process at the other end. Clients
find the path of the socket by `contactd_client/paths.py`.
"""

import contextlib
import grp
import logging
import os
import socket
import stat
import struct
from dataclasses import dataclass
from pathlib import Path

from common.errors import ControlError

# Few, as a client with a stop queues behind all that wait. When it is full, clients retry at once.
LISTEN_BACKLOG = 64
_UCRED = struct.Struct("3i")  # pid, uid, gid
_SO_PEERGROUPS = 59  # Linux 4.13; not in Python's socket module
_MOST_GROUPS = 256

_log = logging.getLogger("contactd")


def default_hand_path() -> Path:
    """Path of the simulator's socket for `contactctl hand`: `$CONTACTD_HAND`, else
    `$XDG_RUNTIME_DIR/contactd-hand.sock`, else `/tmp/contactd-hand-UID.sock`. It is the user's own,
    as the simulator is."""
    if chosen := os.environ.get("CONTACTD_HAND"):
        return Path(chosen)
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "contactd-hand.sock"
    return Path(f"/tmp/contactd-hand-{os.getuid()}.sock")


def listen(path: Path, group: str) -> socket.socket:
    """Listening socket at `path`, which appears there complete: bound, open to `group`, and
    listening. Raises ControlError if another daemon serves it or it cannot be made."""
    hidden = path.with_name(f".{path.name}.{os.getpid()}")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    try:
        _refuse_unless_stale(path)
        hidden.unlink(missing_ok=True)
        # Linux takes the file's mode from the socket: no client can connect before the group is
        # set.
        os.fchmod(listener.fileno(), 0o600)
        listener.bind(str(hidden))
        if why := open_to_group(hidden, 0o660, group):
            owner = hidden.stat().st_gid
            _log.warning("group %s %s: %s is open to group %d", group, why, path.name, owner)
        listener.listen(LISTEN_BACKLOG)
        hidden.rename(path)
    except OSError as error:
        listener.close()
        with contextlib.suppress(OSError):
            hidden.unlink(missing_ok=True)
        raise ControlError(f"cannot listen at {path}: {error.strerror or error}") from error
    except ControlError:
        listener.close()
        raise
    return listener


def _refuse_unless_stale(path: Path) -> None:
    """Raise ControlError unless `path` is free or holds the socket of a dead daemon."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise ControlError(f"{path} exists and is not a socket; remove it or choose another path")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            return
        except BlockingIOError:  # alive, with a full backlog
            raise ControlError(f"another contactd serves {path}") from None
        raise ControlError(f"another contactd (pid {peer_of(probe).pid}) serves {path}")


def open_to_group(path: Path, mode: int, group: str) -> str:
    """Give the file to `group` with `mode`. Returns the reason if the group could not be set, else
    an empty text."""
    why = ""
    try:
        wanted = grp.getgrnam(group).gr_gid
        if path.stat().st_gid != wanted:
            os.chown(path, -1, wanted)
    except (KeyError, PermissionError) as error:
        why = "does not exist" if isinstance(error, KeyError) else "is not one of the daemon's"
    path.chmod(mode)
    return why


@dataclass(frozen=True, slots=True)
class Peer:
    """Process at the other end of a connection, as the kernel saw it connect."""

    uid: int
    pid: int
    connection: int = 0  # serial number, unique within one daemon


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
