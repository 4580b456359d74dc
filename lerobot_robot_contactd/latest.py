"""Latest State of an arm, read by a thread, so that an observation does not block."""

import threading
import time
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from contactd_client import Client, ContactdError, usual_socket_path, view_socket_path
from contactd_client.messages import State

OLDEST_S: Final = 0.5
"""Age from which a State is no longer used."""
FIRST_S: Final = 5.0


def control_socket(given: str) -> Path:
    """Path of a control socket; the usual one if none is given."""
    return Path(given) if given else usual_socket_path()


class LatestState:
    """Latest State of one arm, from construction to `close`. Raises UnreachableError."""

    def __init__(self, socket: str) -> None:
        self._client = Client(view_socket_path(control_socket(socket)))
        self._states = self._client.states()[1]
        self._state: State | None = None
        self._came_s, self._why = 0.0, ""
        self._arrived = threading.Event()
        self._thread = threading.Thread(target=self._read, name="contactd", daemon=True)
        self._thread.start()

    def _read(self) -> None:
        try:
            for state in self._states:
                self._state, self._came_s = state, time.monotonic()
                self._arrived.set()
        except (ContactdError, OSError, ValueError) as error:
            self._why = str(error)
            self._arrived.set()

    def get(self) -> State:
        """Latest State. Raises ConnectionError if there is none younger than OLDEST_S."""
        self._arrived.wait(FIRST_S)
        state = self._state
        if state is None or time.monotonic() - self._came_s > OLDEST_S:
            raise ConnectionError(f"contactd sends no States: {self._why or 'it is silent'}")
        return state

    def close(self) -> None:
        """Close the connection, which ends the thread."""
        self._client.close()


class OfContactd:
    """Base of robot and leader: joints, actions, and no calibration."""

    config: Any
    _latest: LatestState | None

    @cached_property
    def joints(self) -> list[str]:
        """Names of the joints, as reported by the daemon. Raises UnreachableError without one."""
        with Client(view_socket_path(control_socket(self.config.socket))) as client:
            return list(client.status()["joints"])

    @cached_property
    def action_features(self) -> dict[str, type]:
        """Names and types of an action."""
        return {f"{joint}.pos": float for joint in self.joints}

    @property
    def is_connected(self) -> bool:
        """True between `connect` and `disconnect`."""
        return self._latest is not None

    @property
    def is_calibrated(self) -> bool:
        """True: calibration is done by `contactd identify`."""
        return True

    def calibrate(self) -> None:
        """Do nothing, as for `is_calibrated`."""

    def configure(self) -> None:
        """Do nothing: all settings are in `config.yaml`."""
