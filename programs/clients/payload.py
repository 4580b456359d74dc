"""Words on the payload of an arm."""

from daemon.protocol.replies import Status


def payload_in_words(status: Status) -> str:
    """Announced payload in words, or that there is none."""
    if status.payload is None:
        return "none; a payload announced before the daemon started is forgotten"
    return f"{status.payload} of {status.hand}; forgotten when the daemon ends"
