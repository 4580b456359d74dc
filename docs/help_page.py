"""docs/troubleshooting.md as a page of the page's server, to which its fault banner links.

Who stands at the arm with a phone has no clone: the page's server brings that page along. Links
to other documents, which it does not bring, become plain words.
"""

import re
from itertools import pairwise

from markdown_it import MarkdownIt
from markdown_it.token import Token

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>contactd: when something is wrong</title>
<link rel="icon" href="icon.svg" type="image/svg+xml">
<link rel="stylesheet" href="page.css">
</head>
<body>
<main class="text">
{}</main>
</body>
</html>
"""


def help_page(markdown: str) -> str:
    """HTML of the page; its headings have the anchors that GitHub gives them."""
    parser = MarkdownIt()
    tokens = parser.parse(markdown)
    for opening, heading in pairwise(tokens):
        if opening.type == "heading_open":
            opening.attrSet("id", anchor(heading.content))
        if opening.children:
            opening.children = _without_links_elsewhere(opening.children)
    return PAGE.format(parser.renderer.render(tokens, parser.options, {}))


def anchor(title: str) -> str:
    """Anchor of a heading."""
    return re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")


def _without_links_elsewhere(words: list[Token]) -> list[Token]:
    kept, inside = [], False
    for word in words:
        if word.type == "link_open":
            inside = str(word.attrGet("href")).startswith("#")
        if inside or word.type not in ("link_open", "link_close"):
            kept.append(word)
    return kept
