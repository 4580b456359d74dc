"""Paths of the daemon's two sockets, their groups, and reasons why one is not accessible."""

import contextlib
import os
from pathlib import Path
from typing import Final

from contactd_client.errors import ControlError

CONTROL_GROUP: Final = "contact"
VIEW_GROUP: Final = "contact-view"
SERVICE_SOCKET: Final = Path("/run/contactd/control")
UNIT_FOLDERS: Final = tuple(
    Path(f"{root}/systemd/system") for root in ("/etc", "/usr/local/lib", "/usr/lib", "/lib")
)


def default_socket_path() -> Path:
    """Default path of a daemon's control socket.

    `$CONTACTD_SOCKET`, else `/run/contactd/control` if that directory exists, else
    `$XDG_RUNTIME_DIR/contactd.sock`, else `/tmp/contactd-UID.sock`. As any user may create files in
    /tmp, ControlError is raised if that file belongs to another user.
    """
    if chosen := os.environ.get("CONTACTD_SOCKET"):
        return Path(chosen)
    if SERVICE_SOCKET.parent.is_dir():
        return SERVICE_SOCKET
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "contactd.sock"
    path = Path(f"/tmp/contactd-{os.getuid()}.sock")
    with contextlib.suppress(FileNotFoundError):
        owner = path.lstat().st_uid
        if owner != os.getuid():
            raise ControlError(f"{path} belongs to user {owner}, not to you: refused as unsafe")
    return path


def usual_socket_path() -> Path:
    """Path at which clients look for a daemon: `default_socket_path`, or if nothing is there, that
    of the installed service, even before its first start. Raises ControlError."""
    path = default_socket_path()
    # False also in the folder of another user, which `su` may have left in the environment.
    there = os.access(path, os.F_OK)
    if os.environ.get("CONTACTD_SOCKET") or there or not service_installed():
        return path
    return SERVICE_SOCKET


def service_installed() -> bool:
    """True if systemd has a contactd.service on this machine."""
    return any((folder / "contactd.service").exists() for folder in UNIT_FOLDERS)


def view_socket_path(control: Path) -> Path:
    """Path of the view socket beside a control socket: `contactd-view.sock` for `control` and for
    `contactd.sock`, `NAME-view.sock` for `NAME.sock`."""
    name = "contactd" if control.name == "control" else control.stem
    return control.with_name(f"{name}-view.sock")


def why_unreachable(path: Path, error: OSError) -> str:
    """Reason why connecting to the daemon's socket at `path` failed, as a message with advice."""
    match error:
        case ConnectionRefusedError() if path.exists() and not path.is_socket():
            return f"{path} is not a socket"
        case FileNotFoundError() | ConnectionRefusedError():
            if path == SERVICE_SOCKET and service_installed():
                how = "`sudo systemctl start contactd`; `systemctl status contactd` shows why not"
                return f"no contactd serves {path}: its service does not run ({how})"
            return f"no contactd serves {path}: is it running? (`contactd run CONFIG`)"
        case PermissionError():
            return access_advice(path)
        case TimeoutError():
            return f"the daemon at {path} is busy: it accepts no connections"
        case _:
            return f"cannot connect to {path}: {error.strerror or error}"


def access_advice(path: Path) -> str:
    """Advice for a user who may not open the control socket, or a file beside it."""
    try:
        group = path.group()
    except KeyError:  # without a name
        group = str(path.stat().st_gid)
    except OSError:
        return f"you may not use {path}: you have no access to its folder"
    if group in (CONTROL_GROUP, VIEW_GROUP):
        join = f"sudo usermod -aG {group} YOU; it counts from your next login"
        return f"you may not use {path}: join the group {group} ({join})"
    # Joining another group, such as root's, would give access to far more than the arm.
    wanted = VIEW_GROUP if path.name.endswith("-view.sock") else CONTROL_GROUP
    return (
        f"you may not use {path}: it belongs to the group {group}. Create the group {wanted}, add "
        "yourself, and start the daemon again (docs/installing.md)"
    )
