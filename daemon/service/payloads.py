"""Payloads that may be announced: by mass and place, or by their names in the configuration."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from common.arrays import Vector
from common.errors import ModelError
from daemon.assembly import build_walls
from daemon.config.evidence import void_payloads
from daemon.config.identified import IdentifiedPayload
from daemon.config.load import Robot
from daemon.config.payload_shape import PAYLOAD, with_payload
from daemon.config.schema import NO_PAYLOAD, Configuration
from daemon.config.shapes import MOST_PAIRS, guarded
from daemon.config.worst_loads import PayloadCapacity
from daemon.protocol.bounds import LIGHTEST_KG
from daemon.protocol.requests import SetPayload
from estimator.payload import HEAVIEST_KG, Payload
from estimator.shapes import Capsule
from estimator.walls import Walls


def named_payloads(c: Configuration, tool_place: Sequence[float]) -> dict[str, Payload]:
    """Payloads under `payloads`, by name; those without a place are at the tool point."""
    return {
        name: Payload.of(entry.mass, entry.com or tool_place, name, entry.box)
        for name, entry in c.payloads.items()
    }


@dataclass(slots=True)
class Payloads:
    """Payloads of one arm. Created before the loop runs, as it computes many poses."""

    robot: Robot
    named: dict[str, Payload] = field(init=False)
    hand: str = field(init=False)
    """Name of the link in whose frame they are"""
    _tool_place: list[float] = field(init=False)
    _capacity: PayloadCapacity = field(init=False)

    def __post_init__(self) -> None:
        c, model = self.robot.configuration, self.robot.model
        self.hand, self._tool_place = model.hand, model.tool_place.tolist()
        self._capacity = PayloadCapacity(c, model)
        self.named = named_payloads(c, self._tool_place)

    def asked_for(self, request: SetPayload) -> Payload | None:
        """Payload of a request, None for none. Raises ModelError for an impossible one."""
        if request.name is not None:
            if any(x is not None for x in (request.mass, request.com, request.box)):
                raise ModelError("it takes a `name`, or a `mass` with its `com` and `box`")
            if request.name == NO_PAYLOAD:
                return None
            if request.name not in self.named:
                known = f"there are: {', '.join(self.named)}" if self.named else "there is none"
                raise ModelError(
                    f"no payload {request.name!r} under `payloads` in config.yaml as last read; "
                    f"{known}; a mass is a plain number, in kg"
                )
            robot, payload = self.robot, self.named[request.name]
            if request.name in void_payloads(robot.identified, robot.configuration, robot.urdf):
                place = " ".join(f"{x:g}" for x in payload.com)
                raise ModelError(
                    f"{request.name} was weighed before {IdentifiedPayload.depends} were changed: "
                    f"`contactd identify payload {request.name}` again; until then "
                    f"`contactctl payload {payload.mass:g} --com {place}`, if that is still right"
                )
            return payload
        if request.mass is None:
            raise ModelError("it takes a `name`, or a `mass` with its `com` and `box`")
        if request.mass == 0.0:
            return None
        if not LIGHTEST_KG <= request.mass <= HEAVIEST_KG:
            raise ModelError(
                f"{request.mass:g} kg is not allowed: {LIGHTEST_KG:g} to {HEAVIEST_KG:g} kg; 0 for "
                "nothing"
            )
        com = self._tool_place if request.com is None else request.com
        return Payload.of(request.mass, com, box=request.box)

    def walls(self, payload: Payload | None, q: Vector | None) -> Walls | None:
        """Walls of the arm with this payload, checked at its present q (n,) [rad], if known; None
        without shapes. Raises ModelError for a box if the arm has no shapes, for too many pairs,
        and for a box that reaches into a link."""
        robot = self.robot
        if payload is None or payload.box is None:
            return build_walls(robot)
        if robot.walls is None:
            raise ModelError(
                "the arm has no shapes to guard against a box: `contactd shapes` first, or leave "
                "the box out"
            )
        content = with_payload(robot.walls, payload, robot.model)
        if (pairs := guarded(content)) > MOST_PAIRS:
            raise ModelError(f"{pairs} pairs to guard with its box; at most {MOST_PAIRS}")
        walls = build_walls(replace(robot, walls=content))
        if walls is not None and q is not None and walls.touch(q):
            c = walls.clearance
            for row in np.flatnonzero(np.asarray(c.gap) < 0.0):
                first, second = c.pairs[c.pair[row]]
                # Overlap with surroundings is permitted: the payload may stand on a table.
                if isinstance(second, Capsule) and PAYLOAD in (first.name, second.name):
                    other = first.name if second.name == PAYLOAD else second.name
                    raise ModelError(
                        f"its box reaches {-1000.0 * c.gap[row]:.0f} mm into the shape of {other} "
                        "here: a smaller one, or another pose"
                    )
        return walls

    def too_heavy(self, payload: Payload | None) -> list[str]:
        """Reasons why the motors cannot carry the payload, joint by joint."""
        return [] if payload is None else self._capacity.too_heavy(payload)
