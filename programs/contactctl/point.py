"""Present point of contact of an arm that is being touched, from a few States."""

from itertools import islice

from common.errors import ModelError
from daemon.modes.table import SENSING
from daemon.protocol.replies import Status
from programs.clients.client import Client

_STATES = 10


def point_now(client: Client, status: Status) -> str:
    """Touched link and point in words; empty if no residual exceeds its threshold."""
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
