"""HTTP routes of recordings: list, start, end, download, delete."""

from collections.abc import Callable
from pathlib import Path

from aiohttp import web

from common.errors import LogError
from programs.web.arm import Arm
from programs.web.connections import stay
from programs.web.guard import HEADERS, Refusal
from programs.web.recordings import Recorder
from programs.web.replies import as_json, refused


class RecordingRoutes:
    """Routes to one recorder; `arm_of` finds the arm that a request names."""

    def __init__(self, recorder: Recorder, arm_of: Callable[[web.Request], Arm]) -> None:
        self._recorder, self._arm_of = recorder, arm_of

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the routes; the request's header must repeat `command`."""
        router.add_get("/recordings", self._list)
        router.add_post("/arms/{arm:[0-9]{1,3}}/{command:record}", self._begin)
        router.add_post("/recordings/{command:end}", self._end)
        router.add_get("/recordings/{name}", self._download)
        router.add_post("/recordings/{name}/{command:delete}", self._delete)

    async def _list(self, request: web.Request) -> web.StreamResponse:
        return as_json(self._recorder.shown())

    async def _begin(self, request: web.Request) -> web.StreamResponse:
        arm = self._arm_of(request)
        try:
            self._recorder.start(arm.path, arm.name)
        except LogError as error:
            return refused(Refusal(409, str(error)))
        return as_json(self._recorder.shown())

    async def _end(self, request: web.Request) -> web.StreamResponse:
        await self._recorder.close()
        return as_json(self._recorder.shown())

    async def _download(self, request: web.Request) -> web.StreamResponse:
        path = self._file(request)
        stay(request.transport)
        disposition = f'attachment; filename="{path.name}"'
        return web.FileResponse(path, headers={**HEADERS, "Content-Disposition": disposition})

    async def _delete(self, request: web.Request) -> web.StreamResponse:
        try:
            self._file(request).unlink(missing_ok=True)
        except OSError as error:
            return refused(Refusal(409, f"cannot delete the recording: {error.strerror}"))
        return as_json(self._recorder.shown())

    def _file(self, request: web.Request) -> Path:
        path = self._recorder.file(request.match_info["name"])
        if path is None:
            raise web.HTTPNotFound
        return path
