"""Cross-checks of the drives: profiles against their EDS, values against the drives' integer
ranges, and bus load."""

from collections.abc import Iterator
from pathlib import Path

from common.errors import ConfigurationError
from daemon.config.counts import unrepresentable
from daemon.config.problem import Keys, Problem, at
from daemon.config.schema import Configuration, Joint, drive_of, frames_of
from drivers.can.load import refuse_overload
from drivers.makes import make_of


def profiles(c: Configuration, folder: Path) -> Iterator[Problem]:
    """Problems of each drive profile with its drives and files; paths are relative to `folder`."""
    used = {joint.wiring.profile for joint in c.joints}
    first = next(iter(c.drives))
    for name, profile in c.drives.items():
        if name not in used:
            yield Problem(["drives", name], f"drives.{name}", "no joint uses this profile")
        if type(profile) is not type(c.drives[first]):
            what = f"another make than `{first}`: all drives of an arm must be of one make"
            yield _in_profile(name, ("make",), what)
            continue
        drives = [drive_of(joint, profile) for joint in c.joints if joint.wiring.profile == name]
        make, master = make_of(profile), c.bus.master_node
        for place, what in make.problems(profile, drives, folder, c.period_ms, master):
            yield _in_profile(name, place, what)
        for i, joint in enumerate(c.joints):
            if joint.wiring.profile == name:
                for place, what in make.wrong(drive_of(joint, profile)):
                    yield Problem(*at(i, joint, *map(str, place)), what)
        # Our heartbeat is sent at a third of the timeout, so that one may be lost.
        if profile.master_timeout_ms < 3 * c.period_ms:
            yield Problem(
                ["drives", name, "master_timeout_ms"],
                f"drives.{name}.master_timeout_ms",
                f"{profile.master_timeout_ms} ms must be at least three periods "
                f"({3 * c.period_ms} ms)",
            )


def _in_profile(name: str, place: tuple[str | int, ...], what: str) -> Problem:
    keys: Keys = ["drives", name, *place]
    where = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return Problem(keys, where.removeprefix("."), what)


def counts(c: Configuration) -> Iterator[Problem]:
    """Values outside a drive's integer range: reported at the joint if only some joints with this
    profile are affected, otherwise at the scale that they share."""
    margin = c.supervisor.speed_margin
    for name, profile in c.drives.items():
        users = [(i, joint) for i, joint in enumerate(c.joints) if joint.wiring.profile == name]
        found: dict[tuple[str, ...], list[tuple[int, Joint, str]]] = {}
        for i, joint in users:
            for its, what in unrepresentable(joint, profile, margin):
                found.setdefault(its.at, []).append((i, joint, what))
        for place, places in found.items():
            if len(places) == len(users):
                _, joint, what = places[0]
                yield _in_profile(name, place, f"joint {joint.name}: {what}")
                continue
            for i, joint, what in places:
                yield Problem(*at(i, joint, "wiring", "gear"), f"{name}.{place[0]}: {what}")


def bus_load(c: Configuration) -> Iterator[Problem]:
    """Problem of a bus that cannot carry all frames of one period."""
    try:
        refuse_overload(frames_of(c), c.period_s, c.bus.bitrate)
    except ConfigurationError as error:
        yield Problem(["bus", "bitrate"], "bus.bitrate", str(error))
