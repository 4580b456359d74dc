"""Payload of an arm in words for a person."""

from daemon.protocol.messages import Status


def payload_in_words(status: Status) -> str:
    """What was announced, or that nothing was since the daemon started."""
    if status.payload is None:
        return "none was told since the daemon started; what was told before is forgotten"
    return f"{status.payload} of {status.hand}; forgotten when the daemon ends"
