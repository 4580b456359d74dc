"""Writes the reference pages from the code: `python docs/reference.py`, or `make reference`.

`configuration.md` comes from the schema, its bounds, and the comments beside its fields;
`contactctl.md` from the commands' own help. tests/docs/test_reference.py says when to run it again.
"""

import ast
import inspect
import io
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import msgspec
from msgspec import inspect as types

from daemon.commands.contactctl import main
from daemon.config.schema import Configuration

DOCS = Path(__file__).parent
MADE = "<!-- Made from the code by `make reference`: change it there. -->\n"

CONFIGURATION = """
# Reference of `config.yaml`

One file describes one arm. `contactd check` judges it without touching the bus; every refusal names
file, line, field, value and what is allowed. Unknown keys are refused. SI units at the link side
unless a name says otherwise. A field without a default must be given.
"""

CONTACTCTL = """
# Reference of `contactctl`

What each command says of itself. What they mean for the arm is in [operating.md](operating.md).
"""


def configuration_page() -> str:
    """docs/configuration.md."""
    sections = [_section(cls, fields) for cls, fields in _structs(Configuration)]
    return "\n".join([MADE.rstrip() + CONFIGURATION, *sections])


def contactctl_page() -> str:
    """docs/contactctl.md."""
    parts = [MADE.rstrip() + CONTACTCTL, _help(main, "contactctl")]
    for name, command in main.commands.items():
        parts.append(f"\n## {name}\n\n{_help(command, f'contactctl {name}')}")
    return "\n".join(parts)


def _help(command: click.Command, name: str) -> str:
    context = click.Context(command, info_name=name, terminal_width=80, max_content_width=80)
    context.help_option_names = ["-h", "--help"]
    text = command.get_help(context).replace("\b", "").rstrip()
    return f"```\n{text}\n```"


# --- the schema -----------------------------------------------------------------------------------


def _structs(first: type) -> Iterator[tuple[type, tuple[types.Field, ...]]]:
    """Every struct of the schema, in the order in which a reader meets them."""
    queue, seen = [first], set()
    while queue:
        cls = queue.pop(0)
        if cls in seen:
            continue
        seen.add(cls)
        info = types.type_info(cls)
        assert isinstance(info, types.StructType)
        yield cls, info.fields
        queue += [inner for field in info.fields for inner in _inner(field.type)]


def _inner(kind: types.Type) -> Iterator[type]:
    """Structs inside a type."""
    match kind:
        case types.StructType():
            yield kind.cls
        case types.UnionType():
            for part in kind.types:
                yield from _inner(part)
        case types.DictType():
            yield from _inner(kind.value_type)
        case types.ListType() | types.VarTupleType():
            yield from _inner(kind.item_type)


def _section(cls: type, fields: tuple[types.Field, ...]) -> str:
    said = _comments(cls)
    title = "The file" if cls is Configuration else cls.__name__
    lines = [f"## {title}\n", inspect.getdoc(cls) or "", ""]
    lines += ["| key | value | default | meaning |", "|---|---|---|---|"]
    for field in fields:
        default = _default(field)
        lines.append(
            f"| `{field.encode_name}` | {_words(field.type)} | {default} | "
            f"{said.get(field.name, '')} |"
        )
    return "\n".join(lines) + "\n"


def _default(field: types.Field) -> str:
    if field.default is msgspec.NODEFAULT and field.default_factory is msgspec.NODEFAULT:
        return "must be given"
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    if value is None:
        return "none"
    if isinstance(value, msgspec.Struct):
        return "its defaults"
    if isinstance(value, tuple | list | dict):
        return "empty" if not value else ", ".join(f"`{_plain(item)}`" for item in value)
    return f"`{_plain(value)}`"


def _plain(value: Any) -> str:
    if isinstance(value, msgspec.Struct):
        names = {k: v for k, v in msgspec.structs.asdict(value).items() if v is not None}
        return "{" + ", ".join(f"{k}: {_plain(v)}" for k, v in names.items()) + "}"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _words(kind: types.Type) -> str:  # noqa: PLR0911 - a line for each kind
    """A type and its bounds, for people."""
    match kind:
        case types.StructType():
            return f"[{kind.cls.__name__}](#{kind.cls.__name__.lower()})"
        case types.IntType():
            return "whole number" + _bounds(kind)
        case types.FloatType():
            return "number" + _bounds(kind)
        case types.StrType():
            return "text"
        case types.BoolType():
            return "`true` or `false`"
        case types.LiteralType():
            return " or ".join(f"`{value}`" for value in kind.values)
        case types.EnumType():
            return " or ".join(f"`{member.value}`" for member in kind.cls)
        case types.NoneType():
            return "none"
        case types.UnionType():
            return ", or ".join(_words(part) for part in kind.types)
        case types.ListType() | types.VarTupleType():
            return f"list of {_words(kind.item_type)}"
        case types.DictType():
            return f"by {_words(kind.key_type)}: {_words(kind.value_type)}"
    raise NotImplementedError(kind)


def _bounds(kind: types.IntType | types.FloatType) -> str:
    low = kind.gt if kind.gt is not None else kind.ge
    high = kind.lt if kind.lt is not None else kind.le
    words = []
    if low is not None:
        words.append(f"{'>' if kind.gt is not None else '>='} {low:.10g}")
    if high is not None:
        words.append(f"{'<' if kind.lt is not None else '<='} {high:.10g}")
    return " " + " and ".join(words) if words else ""


def _comments(cls: type) -> dict[str, str]:
    """What stands beside or above each field in the code."""
    source = inspect.getsource(cls)
    tree = ast.parse(source).body[0]
    assert isinstance(tree, ast.ClassDef)
    above: dict[int, str] = {}
    beside: dict[int, str] = {}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            alone = not token.line[: token.start[1]].strip()
            (above if alone else beside)[token.start[0]] = token.string.lstrip("# ")
    said: dict[str, str] = {}
    for node in tree.body:
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        words = [beside[n] for n in range(node.lineno, (node.end_lineno or 0) + 1) if n in beside]
        line, lead = node.lineno - 1, []
        while line in above:
            lead.insert(0, above[line])
            line -= 1
        said[node.target.id] = " ".join([*lead, *words]).replace("|", "\\|")
    return said


def write() -> None:
    """Both pages."""
    (DOCS / "configuration.md").write_text(configuration_page(), encoding="utf-8")
    (DOCS / "contactctl.md").write_text(contactctl_page(), encoding="utf-8")


if __name__ == "__main__":
    write()
