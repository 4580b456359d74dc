"""Payloads that may be announced: by mass and place, or by their names in the configuration."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from common.errors import ModelError
from daemon.config.load import Robot
from daemon.config.schema import NO_PAYLOAD, Configuration
from daemon.config.worst_loads import Carrying
from daemon.protocol.bounds import LIGHTEST_KG
from daemon.protocol.requests import SetPayload
from estimator.payload import HEAVIEST_KG, Payload


def named_payloads(c: Configuration, tool_place: Sequence[float]) -> dict[str, Payload]:
    """Payloads under `payloads`, by name; those without a place are at the tool point."""
    return {
        name: Payload.of(entry.mass, entry.com or tool_place, name)
        for name, entry in c.payloads.items()
    }


@dataclass(slots=True)
class Payloads:
    """Payloads of one arm. Created before the loop runs, as it computes many poses."""

    robot: Robot
    named: dict[str, Payload] = field(init=False)
    hand: str = field(init=False)
    """name of the link in whose frame they are"""
    _tool_place: list[float] = field(init=False)
    _carrying: Carrying = field(init=False)

    def __post_init__(self) -> None:
        c, model = self.robot.configuration, self.robot.model
        self.hand, self._tool_place = model.hand, model.tool_place.tolist()
        self._carrying = Carrying(c, model)
        self.named = named_payloads(c, self._tool_place)

    def asked_for(self, request: SetPayload) -> Payload | None:
        """Payload of a request, None for none. Raises ModelError for an impossible one."""
        if request.name is not None:
            if request.mass is not None or request.com is not None:
                raise ModelError("it takes a `name`, or a `mass` with its `com`")
            if request.name == NO_PAYLOAD:
                return None
            if request.name not in self.named:
                known = f"there are: {', '.join(self.named)}" if self.named else "there is none"
                raise ModelError(
                    f"no payload {request.name!r} under `payloads` in the configuration; {known}; "
                    "a mass is a plain number, in kg"
                )
            return self.named[request.name]
        if request.mass is None:
            raise ModelError("it takes a `name`, or a `mass` with its `com`")
        if request.mass == 0.0:
            return None
        if not LIGHTEST_KG <= request.mass <= HEAVIEST_KG:
            raise ModelError(
                f"{request.mass:g} kg is not allowed: {LIGHTEST_KG:g} to {HEAVIEST_KG:g} kg; 0 for "
                "nothing"
            )
        com = self._tool_place if request.com is None else request.com
        return Payload.of(request.mass, com)

    def too_heavy(self, payload: Payload | None) -> list[str]:
        """Reasons why the motors cannot carry it, joint by joint."""
        return [] if payload is None else self._carrying.too_heavy(payload)
