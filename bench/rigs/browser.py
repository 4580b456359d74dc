"""Debian's chromium without a window, driven by playwright: for tests, benches and pictures of the
page."""

import contextlib
import shutil
from collections.abc import Iterator
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome")
# Software stands for a graphics card that is not there, slowly.
_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def chromium() -> str | None:
    """Path of a chromium on this machine; None if there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@contextlib.contextmanager
def browser(*, webgl: bool = True) -> Iterator[Any]:
    """A playwright Browser, with WebGL or without. Raises RuntimeError without a chromium."""
    path = chromium()
    if path is None:
        raise RuntimeError("no chromium on this machine: apt install chromium")
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - slow, and only where needed

    with sync_playwright() as playwright:
        how = _WEBGL if webgl else ("--disable-gpu",)
        launched = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", *how])
        try:
            yield launched
        finally:
            launched.close()
