"""HTTP route of arms elsewhere: stop one, or all that are alive."""

from collections.abc import Mapping
from typing import Protocol

from aiohttp import web

from programs.web.guard import Refusal
from programs.web.replies import as_json, refused
from programs.web.words import Elsewhere, Outcome, Outcomes


class Others(Protocol):
    """Arms of other machines; `Router` of `elsewhere.py`, which needs an extra, is one."""

    def shown(self) -> Elsewhere:
        """All of them, as of now."""

    async def stop(self, name: str) -> Mapping[str, Outcome] | None:
        """Stop one, or with an empty name all that are alive; None where too many stops wait."""

    def close(self) -> None:
        """End."""


class ElsewhereRoutes:
    """Route to them."""

    def __init__(self, others: Others) -> None:
        self._others = others

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Answer it; `command` is what the request's own header has to say, too."""
        router.add_post("/elsewhere/{command:stop}", self._stop)

    async def _stop(self, request: web.Request) -> web.StreamResponse:
        name = request.query.get("arm", "")
        if name and name not in [arm.arm for arm in self._others.shown().arms]:
            return refused(Refusal(404, "no such arm elsewhere"))
        found = await self._others.stop(name)
        if found is None:
            return refused(Refusal(503, "too many stops wait for their answers"))
        return as_json(Outcomes(dict(found)))
