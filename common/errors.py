"""Exception tree. Every error that a user may meet derives from `ContactdError`, which the client
for other programs knows, too.

Exit codes follow sysexits.h, so that systemd and scripts can distinguish a bad configuration (78,
never restarted), a bus that is not there (69, worth another try) and a fault of ours (70).
"""

from contactd_client.errors import ContactdError, ControlError, HungUpError, UnreachableError

__all__ = [
    "BusError",
    "ConfigurationError",
    "ContactdError",
    "ControlError",
    "DriveError",
    "HungUpError",
    "LogError",
    "ModelError",
    "ProgramError",
    "ShortLogError",
    "SilentDriveError",
    "TrajectoryError",
    "UnreachableError",
]


class ConfigurationError(ContactdError):
    """A file that the user wrote is wrong; names the file, the field and what is allowed."""

    exit_code = 78


class ModelError(ContactdError):
    """The URDF, or numbers handed to the mathematics, do not fit (shape, range, joint names)."""

    exit_code = 78


class BusError(ContactdError):
    """The CAN bus or its adapter is missing, closed or unusable."""

    exit_code = 69


class DriveError(ContactdError):
    """A drive does not answer or does not hold what was written; names node and object."""

    exit_code = 69


class SilentDriveError(DriveError):
    """A drive gives no answer, or none that can be read; worth another try."""


class ProgramError(ContactdError):
    """Something broke in the running loop that never should; the log has the traceback."""

    exit_code = 70


class TrajectoryError(ContactdError):
    """A trajectory is damaged or breaks a limit; `row` is that of the first sample that does."""

    exit_code = 65

    def __init__(self, text: str, row: int | None = None) -> None:
        super().__init__(text)
        self.row = row


class LogError(ContactdError):
    """A recording is damaged, incomplete or not ours."""

    exit_code = 65


class ShortLogError(LogError):
    """There is too little in a recording; more may be added to it."""
