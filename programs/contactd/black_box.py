"""`contactd black-box`: writes the frames of the last minute to a log, on request."""

from pathlib import Path

import click

from common.errors import LogError, UnreachableError
from common.regular_file import open_regular
from contactd_client.paths import access_advice, usual_socket_path
from daemon.service.black_box import default_directory, ring_path
from daemon.service.black_box_log import new_log, save_left_over, write_context, write_log
from drivers.can.frame_ring import read_frames


def write_frames(socket: Path | None, output: Path | None, *, left_over: bool) -> None:
    """Write a log and print its path. Raises LogError; UnreachableError if this user may not."""
    path, directory = ring_path(socket or usual_socket_path()), default_directory()
    if not _open_to_us(path):
        raise UnreachableError(access_advice(path))
    if left_over:
        # Silent if nothing was saved: in the journal this line follows the reason for the exit.
        if saved := save_left_over(path, directory):
            click.echo(f"saved: {saved}")
        return
    if not path.exists():
        raise LogError(f"{path}: no frame buffer there; is the daemon running, with this socket?")
    frames = read_frames(path)
    target = write_log(frames, output or new_log(directory))
    write_context(path, target)
    seconds = frames[-1].time_s - frames[0].time_s if frames else 0.0
    click.echo(f"{len(frames)} frames, {seconds:.1f} s: {target}")


def _open_to_us(path: Path) -> bool:
    """True if this user may read the ring buffer, or it does not exist."""
    try:
        open_regular(path, follow=False).close()
    except PermissionError:
        return False
    except OSError:
        pass
    return True
