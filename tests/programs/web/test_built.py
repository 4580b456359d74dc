"""The page's bundle: in the repository, so that it runs without node; what page/ gives."""

import gzip
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from programs.web.page_routes import BUILT, TYPES

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "page"


def test_it_is_what_the_sources_give() -> None:
    node = shutil.which("node")
    if node is None or not (PAGE / "node_modules").is_dir():
        pytest.skip("no node or page/node_modules here: the bundle is not built again (make web)")
    done = subprocess.run(
        [node, "build.mjs", "--check"], cwd=PAGE, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_it_is_small_and_complete() -> None:
    files = {path.name: path.read_bytes() for path in BUILT.iterdir()}
    assert {"index.html", "enter.html", "page.js", "scene.js", "page.css"} <= set(files)
    for path in (PAGE / "src").glob("*.html"):
        assert files[path.name] == path.read_bytes(), "run make web"
    assert all(Path(name).suffix in TYPES for name in files)
    sizes = {name: len(gzip.compress(data)) for name, data in files.items()}
    assert sum(sizes.values()) < 250_000
    assert sum(size for name, size in sizes.items() if name != "scene.js") < 60_000


def test_it_loads_nothing_from_elsewhere() -> None:
    """No other site, no inline script or style: the strict policy would refuse them."""
    for name in ("index.html", "enter.html", "page.css"):
        text = (BUILT / name).read_text()
        assert not re.search(r"https?://", text.replace("http://www.w3.org/2000/svg", "")), name
        assert "style=" not in text
        assert "onclick" not in text
        assert not re.search(r"<script(?![^>]*src=)", text)


def test_licences_of_what_is_bundled_come_with_it() -> None:
    licences = (BUILT / "licences.txt").read_text()
    assert all(f"{name} " in licences for name in ("three", "uplot", "urdf-loader"))
