"""Writer of the reference pages from the code: `python docs/reference.py`, or `make reference`.

`configuration.md` comes from the schema, its bounds, and the comments beside its fields;
`schemas/` from the messages of the socket and `simulation.yaml`; the types of `contactd_client/`
from those messages; `concepts/` from `drawings.py`; `programs/zenoh/type_hashes.py` from the
definitions of ROS 2; the page's `troubleshooting.html` from the document of that name. `faults.md`
and `modes.md` are written by hand but for the parts between two markers, which come from what the
program runs on.
tests/docs/test_reference.py says when to run it again.
"""

import inspect
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect as types

from daemon.config.schema import Configuration
from daemon.faults.conditions import Condition, Response
from daemon.faults.symptoms import SECTION_OF
from daemon.faults.table import TABLE
from daemon.modes.contact_reactions import EVENT_OF
from daemon.modes.table import DISARMING, TRANSITIONS, Event, Mode

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))  # of this checkout, and `docs` itself, which is in no wheel

from docs.door import SCHEMAS, client_messages, client_requests, schema  # noqa: E402
from docs.drawings import drawings  # noqa: E402
from docs.fields import comments_of, structs_of  # noqa: E402
from docs.help_page import help_page  # noqa: E402
from docs.ros_types import type_hashes  # noqa: E402

MADE = "<!-- Made from the code by `make reference`: change it there. -->\n"

CONFIGURATION = """
# Reference of `config.yaml`

One file describes one arm. `contactd check` judges it without touching the bus; a refusal names
file, line, field, value and what is allowed. Unknown keys are refused. SI units at the link side
unless a name says otherwise. Keys in bold are required; `(0, 20]; 0.5` is above 0, at most 20, by
default 0.5.
"""


def configuration_page() -> str:
    """docs/configuration.md."""
    sections = [_section(cls, fields) for cls, fields in structs_of(Configuration)]
    return "\n".join([MADE.rstrip() + CONFIGURATION, *sections])


def faults_page() -> str:
    """docs/faults.md, with its parts from the table of faults."""
    page = (DOCS / "faults.md").read_text(encoding="utf-8")
    return filled(page, {"overview": _overview(), "conditions": _conditions()})


def modes_page() -> str:
    """docs/modes.md, with its parts from the tables of modes and of reactions to contacts."""
    page = (DOCS / "modes.md").read_text(encoding="utf-8")
    parts = {
        "diagram": _diagram(),
        "modes": _modes(),
        "events": _events(),
        "reactions": _reactions(),
        "no change": _no_change(),
    }
    return filled(page, parts)


def filled(page: str, parts: Mapping[str, str]) -> str:
    """The page with new text between the markers of each part.

    Raises ValueError unless its markers are those of `parts`, in their order.
    """
    marked = re.compile(
        r"(<!-- ([\w ]+): made by `make reference` -->\n).*?(<!-- end -->)", re.DOTALL
    )
    found = [match[2] for match in marked.finditer(page)]
    if found != list(parts):
        raise ValueError(f"the page has the parts {found}, not {list(parts)}")
    return marked.sub(lambda match: f"{match[1]}\n{parts[match[2]]}\n\n{match[3]}", page)


def _table(*rows: tuple[str, ...]) -> str:
    """Table in Markdown; the first row is the head."""
    escaped = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    head, *others = ["| " + " | ".join(row) + " |" for row in escaped]
    return "\n".join([head, "|---" * len(rows[0]) + "|", *others])


# --- faults ---------------------------------------------------------------------------------------


def _overview() -> str:
    """Conditions by their response."""
    links: dict[Response, list[str]] = {response: [] for response in Response}
    for condition, row in TABLE.items():
        links[row.response].append(f"[{condition}](#{condition.replace(' ', '-')})")
    rows = [(_in_words(response), ", ".join(names)) for response, names in links.items()]
    return _table(("response", "conditions"), *rows)


def _conditions() -> str:
    return "\n\n".join(_condition(condition) for condition in TABLE)


def _condition(condition: Condition) -> str:
    """A section to look up: the words of a fault, and its row."""
    row = TABLE[condition]
    return (
        f"### {condition}\n\n"
        f"**{_in_words(row.response).capitalize()}** (`{row.check}`).\n\n"
        f"*When:* {row.when}.\n\n"
        f"*Why:* {row.why}.\n\n"
        f"*Do:* {_linked(row.advice)}. "
        f"[More](troubleshooting.md#{SECTION_OF[condition]})."
    )


def _linked(text: str) -> str:
    """Other pages, which are paths on a terminal, as links."""
    return re.sub(r"docs/(\w+)\.md", r"[\1](\1.md)", text)


def _in_words(response: Response) -> str:
    return response.name.lower().replace("_", " ")


# --- modes ----------------------------------------------------------------------------------------


def _diagram() -> str:
    """Rows that change the mode, joined where they share both ends."""
    arrows: dict[tuple[Mode, Mode], list[str]] = {}
    for (mode, event), after in TRANSITIONS.items():
        if after is not mode:
            arrows.setdefault((mode, after), []).append(event)
    lines = [f"    {a} --> {b} : {', '.join(events)}" for (a, b), events in arrows.items()]
    return "\n".join(["```mermaid", "stateDiagram-v2", f"    [*] --> {Mode.OFF}", *lines, "```"])


def _no_change() -> str:
    """Rows that leave the mode as it is."""
    events: dict[Mode, list[str]] = {}
    for (mode, event), after in TRANSITIONS.items():
        if after is mode:
            events.setdefault(mode, []).append(f"`{event}`")
    rows = [(f"`{mode}`", ", ".join(names)) for mode, names in events.items()]
    return _table(("mode", "events"), *rows)


def _modes() -> str:
    said = comments_of(Mode)
    return _table(("mode", "what the arm does"), *[(f"`{m}`", said[m.name]) for m in Mode])


def _events() -> str:
    said = comments_of(Event)
    rows = [(f"`{e}`", said[e.name], "x" if e in DISARMING else "") for e in Event]
    return _table(("event", "when", "disarms"), *rows)


def _reactions() -> str:
    rows = [
        (f"`{reaction}`", f"`{event}`" if event else "none") for reaction, event in EVENT_OF.items()
    ]
    return _table(("reaction", "event"), *rows)


# --- the schema -----------------------------------------------------------------------------------


def _section(cls: type, fields: tuple[types.Field, ...]) -> str:
    said = comments_of(cls)
    title = "The file" if cls is Configuration else cls.__name__
    rows = [(_key(f), _words(f.type) + _default(f), said.get(f.name, "")) for f in fields]
    table = _table(("key", "value", "meaning"), *rows) if rows else ""
    return f"## {title}\n\n{inspect.getdoc(cls) or ''}\n\n{table}\n"


def _key(field: types.Field) -> str:
    """Name of a field, in bold if it has no default."""
    return f"**`{field.encode_name}`**" if field.required else f"`{field.encode_name}`"


def _default(field: types.Field) -> str:
    """Default that is a value: not none, nothing, or a struct of defaults."""
    value = field.default
    if value in (msgspec.NODEFAULT, None, "", ()) or isinstance(value, msgspec.Struct):
        return ""
    shown = value if isinstance(value, tuple) else (value,)
    return "; " + ", ".join(f"`{_plain(item)}`" for item in shown)


def _plain(value: Any) -> str:
    if isinstance(value, msgspec.Struct):
        names = {k: v for k, v in msgspec.structs.asdict(value).items() if v not in (None, "")}
        return "{" + ", ".join(f"{k}: {_plain(v)}" for k, v in names.items()) + "}"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _words(kind: types.Type) -> str:  # noqa: PLR0911 - a line for each kind
    """A type and its bounds, for people; not that it may be none."""
    match kind:
        case types.StructType():
            return f"[{kind.cls.__name__}](#{kind.cls.__name__.lower()})"
        case types.IntType():
            return "integer" + _bounds(kind)
        case types.FloatType():
            return "number" + _bounds(kind)
        case types.StrType():
            return "text"
        case types.BoolType():
            return "`true`, `false`"
        case types.LiteralType():
            return ", ".join(f"`{value}`" for value in kind.values)
        case types.EnumType():
            return ", ".join(f"`{member.value}`" for member in kind.cls)
        case types.UnionType():
            return ", ".join(_words(p) for p in kind.types if not isinstance(p, types.NoneType))
        case types.Metadata():
            return f"{_words(kind.type)} {kind.extra['unit']}"
        case types.ListType() | types.VarTupleType():
            return f"list of {_words(kind.item_type)}"
        case types.DictType():
            return f"by {_words(kind.key_type)}: {_words(kind.value_type)}"
        case types.TupleType():
            return f"{len(kind.item_types)} of {_words(kind.item_types[0])}"
    raise NotImplementedError(kind)


def _bounds(kind: types.IntType | types.FloatType) -> str:
    """Interval of a number, or its one bound."""
    low = kind.gt if kind.gt is not None else kind.ge
    high = kind.lt if kind.lt is not None else kind.le
    match low, high:
        case None, None:
            return ""
        case _, None:
            return f" {'>' if kind.gt is not None else '>='} {low:.10g}"
        case None, _:
            return f" {'<' if kind.lt is not None else '<='} {high:.10g}"
    opening, closing = "(" if kind.gt is not None else "[", ")" if kind.lt is not None else "]"
    return f" {opening}{low:.10g}, {high:.10g}{closing}"


PAGES = {
    "configuration": configuration_page,
    "faults": faults_page,
    "modes": modes_page,
}


def files() -> dict[Path, str]:
    """Text of every file that is made here."""
    made = {DOCS / f"{name}.md": page() for name, page in PAGES.items()}
    made |= {DOCS / "schemas" / f"{name}.json": schema(cls) for name, cls in SCHEMAS.items()}
    made |= {DOCS / "concepts" / name: svg for name, svg in drawings().items()}
    trouble = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    return made | {
        DOCS.parent / "programs/web/built/troubleshooting.html": help_page(trouble),
        DOCS.parent / "contactd_client/messages.py": client_messages(),
        DOCS.parent / "contactd_client/requests.py": client_requests(),
        DOCS.parent / "programs/zenoh/type_hashes.py": type_hashes(),
    }


def write() -> None:
    """All pages, schemas, and the client's types."""
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write()
