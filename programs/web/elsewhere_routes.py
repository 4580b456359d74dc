"""HTTP route that stops one arm, or all that are alive, on other computers."""

from collections.abc import Mapping
from typing import Protocol

from aiohttp import web

from programs.web.guard import Refusal
from programs.web.replies import as_json, refused
from programs.web.words import Elsewhere, Outcome, Outcomes


class Others(Protocol):
    """Interface to arms of other computers; `Router` of `elsewhere.py`, an extra, implements it."""

    def shown(self) -> Elsewhere:
        """Present state of all arms."""

    async def stop(self, name: str) -> Mapping[str, Outcome] | None:
        """Stop one arm, or for an empty name all; None if too many stops are pending."""

    def close(self) -> None:
        """Disconnect."""


class ElsewhereRoutes:
    """Route to the arms of other computers."""

    def __init__(self, others: Others) -> None:
        self._others = others

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the route; the request's header must repeat `command`."""
        router.add_post("/elsewhere/{command:stop}", self._stop)

    async def _stop(self, request: web.Request) -> web.StreamResponse:
        name = request.query.get("arm", "")
        if name and name not in [arm.arm for arm in self._others.shown().arms]:
            return refused(Refusal(404, "no such arm elsewhere"))
        found = await self._others.stop(name)
        if found is None:
            return refused(Refusal(503, "too many stops are waiting for answers"))
        return as_json(Outcomes(dict(found)))
