"""Stream of targets in words for a person: its phase and quality, on one line each."""

from collections.abc import Sequence

from daemon.protocol.state import StreamState

PHASES = {
    "joining": "the arm goes slowly to the stream",
    "following": "the arm follows",
    "stalled": "no target comes: the arm stands",
    "waiting": "the arm stands until the stream is near it",
    "interrupted": "the arm yields to a contact",
    "paused": "the arm holds until `contactctl start`",
}


def stream_in_words(stream: StreamState, q: Sequence[float]) -> str:
    """Phase of the arm on a stream and its distance from the newest target, at q (n,) [rad]; in a
    second line rate, age, jitter and losses."""
    behind = max((abs(a - b) for a, b in zip(stream.target, q, strict=False)), default=0.0)
    rate = "" if stream.rate_hz is None else f"{stream.rate_hz:.0f} Hz, "
    counts = {
        "lost": stream.lost,
        "dropped": stream.dropped,
        "beyond joint limits": stream.bounded,
        "refused": stream.refused,
    }
    bad = "".join(f", {count} {name}" for name, count in counts.items() if count)
    return (
        f"{stream.phase}: {PHASES[stream.phase]}; {behind:.3f} rad behind the newest target\n"
        f"{rate}newest {1e3 * stream.age_s:.0f} ms old, jitter {1e3 * stream.jitter_s:.0f} ms, "
        f"delay {1e3 * stream.delay_s:.0f} ms{bad}"
    )
