"""Point of contact of now: the States of a moment, while an arm is touched."""

from itertools import islice

from common.errors import ModelError
from daemon.modes.table import SENSING
from daemon.protocol.replies import Status
from programs.clients.client import Client

_STATES = 10


def point_now(client: Client, status: Status) -> str:
    """Touched link and point in words; empty where nothing is beyond its level."""
    pairs = zip(status.residual, status.threshold, strict=True)
    if status.mode not in SENSING or not any(abs(r) > level for r, level in pairs):
        return ""
    from programs.recordings.touch_point import TouchFinder, touch_words  # noqa: PLC0415 - numpy

    snapshot, states = client.subscribe()
    try:
        finder = TouchFinder.of(snapshot)
    except ModelError:
        return ""
    found = [finder.see(state) for state in islice(states, _STATES)]
    return touch_words(found[-1]) if found and found[-1] else ""
