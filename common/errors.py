"""Exception hierarchy. Every error that a user may see derives from `ContactdError`, which the
client library defines.

Exit codes follow sysexits.h, so that systemd and scripts can distinguish a bad configuration (78,
never restarted), a missing bus (69, worth a retry) and an internal fault (70).
"""

from contactd_client.errors import ClosedError, ContactdError, ControlError, UnreachableError

__all__ = [
    "BusError",
    "ClosedError",
    "ConfigurationError",
    "ContactdError",
    "ControlError",
    "DriveError",
    "LogError",
    "ModelError",
    "ProgramError",
    "ShortLogError",
    "SilentDriveError",
    "TrajectoryError",
    "UnreachableError",
]


class ConfigurationError(ContactdError):
    """Error in a file that the user wrote; names the file, the field and what is allowed."""

    exit_code = 78


class ModelError(ContactdError):
    """Inconsistent URDF, or numbers of a wrong shape or range, or wrong joint names."""

    exit_code = 78


class BusError(ContactdError):
    """Missing, closed or unusable CAN bus or adapter."""

    exit_code = 69


class DriveError(ContactdError):
    """A drive that does not answer, or does not hold the value written; names node and object."""

    exit_code = 69


class SilentDriveError(DriveError):
    """A drive that gives no answer, or no readable one; worth a retry."""


class ProgramError(ContactdError):
    """Internal error in the running loop that should never occur; the log has the traceback."""

    exit_code = 70


class TrajectoryError(ContactdError):
    """A trajectory that is damaged or violates a limit; `row` is the index of the first such
    sample."""

    exit_code = 65

    def __init__(self, text: str, row: int | None = None) -> None:
        super().__init__(text)
        self.row = row


class LogError(ContactdError):
    """A recording that is damaged, incomplete or not made by contactd."""

    exit_code = 65


class ShortLogError(LogError):
    """A recording with too little data; more may be appended to it."""
