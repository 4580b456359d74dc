"""HTTP routes of the page: its built files, and the form for the token."""

import html
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final
from urllib.parse import parse_qs

from aiohttp import web

from programs.web.guard import COOKIE, Refusal, TokenCheck

BUILT: Final = Path(__file__).parent / "built"
TYPES: Final = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}
ACCESS_YEAR_S: Final = 365 * 86400


class PageRoutes:
    """Routes to the built files; `address_of` returns the address that a request comes from."""

    def __init__(
        self, token: TokenCheck, address_of: Callable[[web.Request], str], *, tls: bool
    ) -> None:
        self._token, self._address_of, self._tls = token, address_of, tls
        self._files = {path.name: path.read_bytes() for path in BUILT.iterdir()}

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the routes; the last one matches all names that no earlier route has."""
        router.add_get("/", self._index)
        router.add_post("/enter", self._enter)
        router.add_get("/{file}", self._file)

    async def _index(self, request: web.Request) -> web.StreamResponse:
        if token := request.query.get("token"):
            return self._let_in(request, token)
        admitted = self._token.admits(request.cookies.get(COOKIE, ""))
        return self._built("index.html" if admitted else "enter.html")

    async def _enter(self, request: web.Request) -> web.StreamResponse:
        # Only the encoding that our form uses; a stranger must not choose another.
        form = parse_qs((await request.read()).decode("ascii", "replace"))
        return self._let_in(request, form.get("token", [""])[0])

    def _let_in(self, request: web.Request, token: str) -> web.StreamResponse:
        """Set the cookie of a browser with the right token, and redirect to a URL without it."""
        if self._token.token:
            address = self._address_of(request)
            if refusal := self._token.enter(token.strip(), address, time.monotonic()):
                return self._asked_again(refusal)
        response = web.Response(status=303, headers={"Location": "/"})
        if self._token.token:
            response.set_cookie(
                COOKIE,
                self._token.cookie,
                max_age=ACCESS_YEAR_S,
                httponly=True,
                samesite="Strict",
                secure=self._tls,
            )
        return response

    def _asked_again(self, refusal: Refusal) -> web.StreamResponse:
        """Form for the token, with the reason of the last refusal."""
        why = f'<p role="alert">{html.escape(refusal.text.capitalize())}.</p>'.encode()
        body = self._files["enter.html"].replace(b"<!-- refusal -->", why)
        return web.Response(status=refusal.status, body=body, content_type="text/html")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        return self._built(request.match_info["file"])

    def _built(self, name: str) -> web.StreamResponse:
        body = self._files.get(name)
        if body is None:
            raise web.HTTPNotFound
        response = web.Response(body=body)
        response.content_type = TYPES[Path(name).suffix]
        response.charset = "utf-8"
        response.enable_compression()
        return response
