"""Commands that the documentation names, so that tests run them or see that they are there.

A *line* stands in a block (indented, or fenced as `sh` or `console`) and is meant to be typed as it
is; a *mention* stands between backticks in a sentence, perhaps with a name in capitals for what you
choose. What a block shows beside its commands, such as answers, begins with no known program.
"""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]

OURS: Final = (
    "contactd",
    "contactctl",
    "contactd-web",
    "contactd-zenoh",
    "contactd-foxglove",
)
OTHERS: Final = (
    *("apt", "apt-get", "cp", "dask", "dpkg", "export", "git", "ip", "journalctl", "make", "npm"),
    *("pip", "python", "ros2", "source", "sudo", "systemctl", "zenohd"),
)
# Where a block's line goes on with what is no command: `contactctl: start: refused`.
_ANSWER = re.compile(r"^[\w-]+:")
_MENTION = re.compile(rf"`((?:{'|'.join(OURS)}) [^`\n]+)`")
_SHELLS = ("```sh", "```console")
_BLOCK = re.compile(r"^( {4,}|\t)")


@dataclass(frozen=True, slots=True)
class Named:
    """A command, and where it stands."""

    page: str  # relative to the root
    line: int  # from 1
    words: tuple[str, ...]  # as a shell splits them, without `.venv/bin/`, `$` and comment
    mention: bool  # in a sentence

    @property
    def text(self) -> str:
        """The command as it is typed."""
        return shlex.join(self.words)

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


def pages() -> list[Path]:
    """README, and every page of docs that is not a decision: those say what was, not what is."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def commands_of(page: Path) -> Iterator[Named]:
    """Commands of a page, in its order."""
    name, fence = str(page.relative_to(ROOT)), ""
    for number, text in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if text.lstrip().startswith("```"):
            fence = "" if fence else text.strip()
        elif _BLOCK.match(text) if not fence else fence in _SHELLS:
            for words in _typed(text.strip()):
                yield Named(name, number, words, mention=False)
        elif not fence:
            for mention in _MENTION.findall(text):
                yield Named(name, number, tuple(_split(mention)), mention=True)


def _typed(text: str) -> Iterator[tuple[str, ...]]:
    """Commands of a line of a block; none where it is something else."""
    text = text.removeprefix("$ ")
    if _ANSWER.match(text):
        return
    for words in _split_at_semicolons(text):
        if words and words[0].removeprefix(".venv/bin/") in (*OURS, *OTHERS):
            yield (words[0].removeprefix(".venv/bin/"), *words[1:])


def _split_at_semicolons(text: str) -> list[list[str]]:
    lists: list[list[str]] = [[]]
    for word in _split(text):
        begins_next = word.endswith(";")
        lists[-1].append(word.removesuffix(";"))
        if begins_next:
            lists.append([])
    return lists


def _split(text: str) -> list[str]:
    """Words as a shell has them, a comment left out; none of what no shell would take."""
    try:
        return shlex.split(text, comments=True)
    except ValueError:
        return []
