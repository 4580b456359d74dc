"""Words on a stream of targets: its phase and quality, one line each."""

from collections.abc import Sequence

from daemon.protocol.state import StreamState

PHASES = {
    "joining": "the arm goes slowly to the stream",
    "following": "the arm follows",
    "stalled": "no targets arrive: the arm stands",
    "waiting": "the arm stands until the stream is within 0.05 rad of it",
    "interrupted": "the arm yields to a contact",
    "paused": "the arm holds until `contactctl start`",
}

AFTER_CONTACT = {"hold": "waits for the stream", "rejoin": "goes slowly back to the stream"}


def phase_in_words(stream: StreamState) -> str:
    """Phase of a stream in one line, which only changes with the phase."""
    return f"{stream.phase}: {PHASES[stream.phase]}"


def quality_in_words(stream: StreamState, q: Sequence[float]) -> str:
    """Largest distance of the arm, at q (n,) [rad], from the newest target; rate, age, jitter and
    losses of the stream, in one line."""
    behind = max((abs(a - b) for a, b in zip(stream.target, q, strict=False)), default=0.0)
    rate = "" if stream.rate_hz is None else f"{stream.rate_hz:.0f} Hz, "
    counts = {
        "lost": stream.lost,
        "dropped": stream.dropped,
        "beyond limits": stream.bounded,
        "refused": stream.refused,
    }
    bad = "".join(f", {count} {name}" for name, count in counts.items() if count)
    return (
        f"{behind:.3f} rad behind; {rate}{1e3 * stream.age_s:.0f} ms old, "
        f"jitter {1e3 * stream.jitter_s:.0f} ms, delay {1e3 * stream.delay_s:.0f} ms{bad}"
    )
