"""Answers of the page's server: a message as JSON, and a refusal as text."""

import msgspec
from aiohttp import web

from programs.web.guard import Refusal


def as_json(message: msgspec.Struct) -> web.Response:
    """The message, for the page's own scripts."""
    return web.Response(body=msgspec.json.encode(message), content_type="application/json")


def refused(refusal: Refusal) -> web.Response:
    """The reason of a refusal, with its status."""
    return web.Response(status=refusal.status, text=f"{refusal.text}\n")
