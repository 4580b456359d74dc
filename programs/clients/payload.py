"""Payload of an arm in words for a person."""

from daemon.protocol.replies import Status


def payload_in_words(status: Status) -> str:
    """Announced payload, or none."""
    if status.payload is None:
        return "none; a payload announced before the daemon started is forgotten"
    return f"{status.payload} of {status.hand}; forgotten when the daemon ends"
