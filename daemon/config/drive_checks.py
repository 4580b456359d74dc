"""Cross checks of drives: profile against EDS, figures against the drive's integers, load of the
bus."""

from collections.abc import Iterator
from pathlib import Path

from common.errors import ConfigurationError
from daemon.config.counts import unrepresentable
from daemon.config.problem import Keys, Problem, at
from daemon.config.schema import Configuration, Joint, drive_of
from drivers.canopen.boot.data_sheet import load_data_sheet
from drivers.canopen.boot.required_objects import DriveSetup, ProfileKeys, problems
from drivers.canopen.bus_load import refuse_overload
from drivers.canopen.codec import LayoutError
from drivers.canopen.settings import PdoEntry


def profiles(c: Configuration, folder: Path) -> Iterator[Problem]:
    """Problems of each drive with its EDS; paths are relative to `folder`."""
    used = {joint.wiring.profile for joint in c.joints}
    for name, profile in c.drives.items():
        if name not in used:
            yield Problem(["drives", name], f"drives.{name}", "no joint uses this profile")
        yield from _data_sheet(c, name, folder)
        # A drive must survive one lost heartbeat of ours, which is sent every third of the time.
        if profile.master_timeout_ms < 3 * c.period_ms:
            yield Problem(
                ["drives", name, "master_timeout_ms"],
                f"drives.{name}.master_timeout_ms",
                f"{profile.master_timeout_ms} ms must be at least three periods "
                f"({3 * c.period_ms} ms)",
            )


def _data_sheet(c: Configuration, name: str, folder: Path) -> list[Problem]:
    """Contradictions between an EDS and a profile with the joints that use it, each once, at the
    field of the profile that asks for what is not there."""
    profile = c.drives[name]
    try:
        sheet = load_data_sheet(folder / profile.eds)
    except ConfigurationError as error:
        return [_in_profile(name, ("eds",), str(error))]
    drives = [drive_of(joint, profile) for joint in c.joints if joint.wiring.profile == name]
    setups = [DriveSetup(drive, sheet) for drive in drives]
    try:
        found = [p for s in setups for p in problems(s, c.period_ms, c.bus.master_node)]
    except LayoutError as error:
        return [_in_profile(name, error.at, str(error))]
    return [_in_profile(name, p.at, f"{profile.eds}: {p.what}") for p in dict.fromkeys(found)]


def _in_profile(name: str, place: ProfileKeys, what: str) -> Problem:
    keys: Keys = ["drives", name, *place]
    where = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return Problem(keys, where.removeprefix("."), what)


def counts(c: Configuration) -> Iterator[Problem]:
    """Values outside a drive's integer range: reported at the joint if only some joints with such
    a drive are affected, otherwise at the scale that they share."""
    margin = c.supervisor.speed_margin
    for name, profile in c.drives.items():
        users = [(i, joint) for i, joint in enumerate(c.joints) if joint.wiring.profile == name]
        found: dict[PdoEntry, list[tuple[int, Joint, str]]] = {}
        for i, joint in users:
            for entry, what in unrepresentable(joint, profile, margin):
                found.setdefault(entry, []).append((i, joint, what))
        for entry, places in found.items():
            if len(places) == len(users):
                _, joint, what = places[0]
                yield _in_profile(name, (entry, "scale"), f"joint {joint.name}: {what}")
                continue
            for i, joint, what in places:
                yield Problem(*at(i, joint, "wiring", "gear"), f"{name}.{entry}: {what}")


def bus_load(c: Configuration) -> Iterator[Problem]:
    """Problem of a bus that cannot carry the frames of a period."""
    try:
        refuse_overload(c.joint_drives, c.period_s, c.bus.bitrate)
    except ConfigurationError as error:
        yield Problem(["bus", "bitrate"], "bus.bitrate", str(error))
