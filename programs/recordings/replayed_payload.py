"""Payload in the hand during a replay: as recorded, unless it is overridden.

`--set payload=VALUE` overrides it throughout: `none`, a mass [kg] at the tool point, a name under
`payloads`, or `{mass: 0.4, com: [0, 0, 0.05]}`. `--set payloads.NAME.mass=0.5` changes a payload
that was carried under that name. An unannounced load suspends learning, as it did when recorded,
unless the payload is overridden.
"""

from collections.abc import Sequence
from typing import Any

import msgspec

from common.errors import ConfigurationError, ModelError
from daemon.config.schema import NO_PAYLOAD, Configuration, PayloadEntry
from daemon.protocol.state import State
from daemon.service.payloads import named_payloads
from estimator.estimator import Estimator
from estimator.model import Model
from estimator.payload import Payload
from programs.recordings.settings import PAYLOAD, Change, as_option, parsed_value

_UNKNOWN = object()  # payload of an estimator before the first State


class ReplayedPayload:
    """Payload to be set in an estimator, State by State. Raises ConfigurationError for an invalid
    payload."""

    def __init__(self, changes: Sequence[Change], c: Configuration, model: Model) -> None:
        self._place = model.tool_place.tolist()
        try:
            self._named = named_payloads(c, self._place)
        except ModelError as error:
            raise ConfigurationError(f"--set payloads: {error}") from error
        asked = [value for path, value in changes if path == PAYLOAD]
        self._overridden = bool(asked)
        self._asked = self._parsed(asked[-1]) if asked else None
        self._before: object = _UNKNOWN

    def apply(self, estimator: Estimator, state: State) -> None:
        """Set the payload from this State on, and suspend or resume learning."""
        payload = self._asked if self._overridden else self._recorded(state.payload)
        if payload != self._before:
            estimator.carry(payload)
            self._before = payload
        estimator.freeze_learning(state.recognised is not None and not self._overridden)

    def _recorded(self, payload: Payload | None) -> Payload | None:
        return None if payload is None else self._named.get(payload.name, payload)

    def _parsed(self, value: str) -> Payload | None:
        wanted: Any = parsed_value(PAYLOAD, value)
        if wanted == NO_PAYLOAD:
            return None
        if isinstance(wanted, str):
            if wanted in self._named:
                return self._named[wanted]
            known = ", ".join(self._named) or "none"
            raise ConfigurationError(
                f"{as_option(PAYLOAD, value)}: there is no such name under payloads; there are: "
                f"{known}"
            )
        try:
            entry = msgspec.convert(
                wanted if isinstance(wanted, dict) else {"mass": wanted}, PayloadEntry
            )
            return Payload.of(entry.mass, entry.com or self._place)
        except (msgspec.ValidationError, ModelError) as error:
            raise ConfigurationError(
                f"{as_option(PAYLOAD, value)}: {error}; must be {NO_PAYLOAD}, a mass [kg], a name "
                "of the configuration, or {mass: 0.4, com: [0, 0, 0.05]}"
            ) from error
