"""Responses of the page's server: a message as JSON, a refusal as text."""

import msgspec
from aiohttp import web

from programs.web.guard import Refusal


def as_json(message: msgspec.Struct) -> web.Response:
    """Response with a message as JSON, for the page's scripts."""
    return web.Response(body=msgspec.json.encode(message), content_type="application/json")


def refused(refusal: Refusal) -> web.Response:
    """Response with the status and reason of a refusal."""
    return web.Response(status=refusal.status, text=f"{refusal.text}\n")
