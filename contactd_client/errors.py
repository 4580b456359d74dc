"""Errors of a client of the daemon; `common/errors.py` derives contactd's own from them."""


class ContactdError(Exception):
    """Base of all deliberately raised errors; `str()` is a message for the terminal."""

    exit_code = 1


class ControlError(ContactdError):
    """Refused request to the daemon, or invalid message."""

    exit_code = 1


class UnreachableError(ControlError):
    """Missing, inaccessible or silent daemon."""

    exit_code = 69


class ClosedError(UnreachableError):
    """Connection closed by the daemon, which is ending or reloading its files."""
