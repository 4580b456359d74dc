"""Where daemon and clients meet: the control socket's file, and who may open it."""

import contextlib
import grp
import logging
import os
import socket
import stat
from pathlib import Path

from daemon.peers import peer_of
from errors import ControlError

GROUP = "contact"
LISTEN_BACKLOG = 64

_log = logging.getLogger("contactd")


def default_socket_path() -> Path:
    """Where daemon and clients meet unless told otherwise.

    `$CONTACTD_SOCKET`, else `/run/contactd/control` where that directory exists, else
    `$XDG_RUNTIME_DIR/contactd.sock`, else `/tmp/contactd-UID.sock`. Everybody may create files in
    /tmp: a file of another user at that name raises ControlError.
    """
    if chosen := os.environ.get("CONTACTD_SOCKET"):
        return Path(chosen)
    if Path("/run/contactd").is_dir():
        return Path("/run/contactd/control")
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "contactd.sock"
    path = Path(f"/tmp/contactd-{os.getuid()}.sock")
    with contextlib.suppress(FileNotFoundError):
        owner = path.lstat().st_uid
        if owner != os.getuid():
            raise ControlError(f"{path} belongs to user {owner}, not to you: refused as unsafe")
    return path


def listen(path: Path) -> socket.socket:
    """A listening socket that appears at `path` complete: open to its group, and never deaf."""
    hidden = path.with_name(f".{path.name}.{os.getpid()}")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    try:
        _refuse_unless_stale(path)
        hidden.unlink(missing_ok=True)
        # Linux takes the file's mode from the socket: nobody gets in before the group is set.
        os.fchmod(listener.fileno(), 0o600)
        listener.bind(str(hidden))
        _open_to_group(hidden)
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
    """Only nothing, or the socket that a dead daemon left behind, may be replaced."""
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


def _open_to_group(path: Path) -> None:
    try:
        group = grp.getgrnam(GROUP).gr_gid
        # As a service the daemon makes it so from the beginning, and may change no owners.
        if path.stat().st_gid != group:
            os.chown(path, -1, group)
    except (KeyError, PermissionError) as error:
        why = "does not exist" if isinstance(error, KeyError) else "is not one of the daemon's"
        owner = path.stat().st_gid
        _log.warning("group %s %s: the control socket is open to group %d", GROUP, why, owner)
    path.chmod(0o660)
