"""Errors that a client of the daemon meets. contactd's own tree, `errors.py`, grows from here."""


class ContactdError(Exception):
    """Root of all errors raised on purpose; `str()` is one message fit for a terminal."""

    exit_code = 1


class ControlError(ContactdError):
    """A request to the daemon was refused, or a message was not understood."""

    exit_code = 1


class UnreachableError(ControlError):
    """There is no daemon, it may not be asked, or it fell silent."""

    exit_code = 69


class HungUpError(UnreachableError):
    """The daemon ended the connection: it ends, or reads its files anew."""
