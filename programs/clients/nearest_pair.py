"""Words on the closest pair of the arm's shapes and surroundings."""

from daemon.protocol.state import Near


def nearest_pair_words(near: Near) -> str:
    """Words such as `forearm - table, 31 mm, slowed`."""
    where = f"{1000.0 * near.distance:.0f} mm"
    if near.distance < 0.0:
        where = "inside: may only move out"
    return f"{' - '.join(near.pair)}, {where}{', slowed' if near.slows else ''}"
