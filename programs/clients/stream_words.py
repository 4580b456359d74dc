"""Stream of targets in words for a person: its phase and quality, on one line each."""

from collections.abc import Sequence

from daemon.protocol.state import StreamState

PHASES = {
    "joining": "the arm goes slowly to the stream",
    "following": "the arm follows",
    "stalled": "no target comes: the arm stands",
    "waiting": "the arm waits until the stream is near it again",
}


def phase_in_words(stream: StreamState) -> str:
    """What the arm does with the stream, and the contact that lasts."""
    phase = PHASES[stream.phase]
    return f"{phase}; {stream.contact}" if stream.contact else phase


def quality_in_words(stream: StreamState, q: Sequence[float]) -> str:
    """Rate, age, jitter and losses of a stream, and how far the arm, at q (n,) [rad], is behind."""
    rate = "" if stream.rate_hz is None else f"{stream.rate_hz:.0f} Hz, "
    behind = max((abs(a - b) for a, b in zip(stream.target, q, strict=False)), default=0.0)
    counts = {
        "lost": stream.lost,
        "dropped": stream.dropped,
        "beyond limits": stream.bounded,
        "refused": stream.refused,
    }
    bad = "".join(f", {count} {name}" for name, count in counts.items() if count)
    return (
        f"{rate}newest {1e3 * stream.age_s:.0f} ms old, jitter {1e3 * stream.jitter_s:.0f} ms, "
        f"delay {1e3 * stream.delay_s:.0f} ms, {behind:.3f} rad behind{bad}"
    )
