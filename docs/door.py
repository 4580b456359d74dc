"""Messages of the daemon's sockets for programs that are not ours: JSON Schemas, and Python types.

Made from `daemon/protocol/`, so that there is one definition. `make reference` writes
them.
"""

import inspect
import json
import textwrap
from typing import Any, Final, get_args

import msgspec
from msgspec import inspect as types

from daemon.modes.table import Mode
from daemon.protocol.replies import Reply
from daemon.protocol.requests import COMMANDS, KINDS, Command, Request, fields_of
from daemon.protocol.state import STATE_FORMAT, State
from docs.fields import comments_of, inner_structs, structs_of

#: Each with all that it holds: Status and Snapshot are in a reply.
SCHEMAS: Final[dict[str, Any]] = {"request": Request, "reply": Reply, "state": State}
WIDTH: Final = 100

HEAD: Final = '''"""Messages of the daemon's sockets, as the dictionaries that they are in JSON.

Made from the code by `make reference`: change them in `daemon/protocol/`. A key that is
NotRequired may be missing: from a daemon that is older, or where it says nothing. Vectors have one
number per joint, in the order of `Snapshot.joints`, SI units at the link side.
"""

from typing import Any, Final, Literal, NotRequired, TypedDict
'''


def schema(cls: Any) -> str:
    """JSON Schema of a message, with what the code says beside its fields."""
    made = msgspec.json.schema(cls)
    for struct, _ in structs_of(*members(cls)):
        properties = made["$defs"][struct.__name__]["properties"]
        for name, text in comments_of(struct).items():
            if text and name in properties:
                properties[name] = {"description": text, **properties[name]}
    made = {"$schema": "https://json-schema.org/draft/2020-12/schema", **_portable(made)}
    return json.dumps(made, indent=1, ensure_ascii=False) + "\n"


def _portable(value: Any) -> Any:
    """Patterns as ECMA 262 has them: the end of the text is $ there, and \\Z means nothing."""
    match value:
        case dict():
            return {
                key: _pattern(inner) if key == "pattern" else _portable(inner)
                for key, inner in value.items()
            }
        case list():
            return [_portable(inner) for inner in value]
    return value


def _pattern(text: str) -> str:
    return text.removesuffix(r"\Z") + "$" if text.endswith(r"\Z") else text


def client_messages() -> str:
    """contactd_client/messages.py: a TypedDict for each message."""
    parts = [
        HEAD,
        f"STATE_FORMAT: Final = {STATE_FORMAT}",
        f"Command = {_literal(COMMANDS)}\nMode = {_literal([mode.value for mode in Mode])}\n",
    ]
    ordered: dict[type, None] = {}
    for cls in SCHEMAS.values():
        for member in members(cls):
            _add(member, ordered)
    kinds = get_args(Request)
    dicts = [_typed_dict(cls) for cls in ordered if cls not in kinds]
    return "\n".join([*parts, *(f"\n{made}" for made in [*dicts, _request_dict()])])


def members(cls: Any) -> tuple[type, ...]:
    """Structs of a union; of a struct, itself."""
    return get_args(cls) or (cls,)


def _request_dict() -> str:
    """One TypedDict for all requests, whose fields say which commands take them."""
    lines = [
        "class Request(TypedDict):",
        '    """One command, with the arguments that only some commands take."""',
        "",
        "    command: Command",
    ]
    takers: dict[str, list[Command]] = {}
    for command in COMMANDS:
        for name in fields_of(command):
            takers.setdefault(name, []).append(command)
    for name, commands in takers.items():
        cls = KINDS[commands[-1]]
        kind = next(field.type for field in types.type_info(cls).fields if field.name == name)
        comment = comments_of(cls).get(name, "")
        if len(commands) < len(COMMANDS):
            comment = f"{', '.join(f'`{c}`' for c in commands)}: {comment}".removesuffix(": ")
        lines += [f"    # {line}" for line in textwrap.wrap(comment, WIDTH - 6)]
        lines.append(f"    {name}: NotRequired[{_annotation(kind)}]")
    return "\n".join([*lines, ""])


def _add(cls: type, ordered: dict[type, None]) -> None:
    """Add a struct behind all that it holds."""
    if cls in ordered:
        return
    for field in types.type_info(cls).fields:
        for inner in inner_structs(field.type):
            _add(inner, ordered)
    ordered[cls] = None


def _typed_dict(cls: type) -> str:
    said = comments_of(cls)
    lines = [f"class {cls.__name__}(TypedDict):"]
    doc = textwrap.dedent(inspect.getdoc(cls) or "")
    lines += textwrap.indent(f'"""{doc}"""', "    ").splitlines()
    lines.append("")
    for field in types.type_info(cls).fields:
        comment = said.get(field.name, "")
        lines += [f"    # {line}" for line in textwrap.wrap(comment, WIDTH - 6)]
        kind = _annotation(field.type)
        lines.append(f"    {field.name}: {kind if field.required else f'NotRequired[{kind}]'}")
    return "\n".join([*lines, ""])


def _annotation(kind: types.Type) -> str:  # noqa: PLR0911, PLR0912 - a line for each kind
    match kind:
        case types.StructType():
            return kind.cls.__name__
        case types.IntType():
            return "int"
        case types.FloatType():
            return "float"
        case types.StrType():
            return "str"
        case types.BoolType():
            return "bool"
        case types.NoneType():
            return "None"
        case types.AnyType():
            return "Any"
        case types.EnumType(cls=cls):
            return cls.__name__
        case types.LiteralType():
            return "Command" if set(kind.values) == set(COMMANDS) else _literal(kind.values)
        case types.UnionType():
            return " | ".join(_annotation(part) for part in kind.types)
        case types.ListType():
            return f"list[{_annotation(kind.item_type)}]"
        case types.Metadata():  # bounds for the schema
            return _annotation(kind.type)
        case types.DictType():
            return f"dict[{_annotation(kind.key_type)}, {_annotation(kind.value_type)}]"
    raise NotImplementedError(kind)


def _literal(values: Any) -> str:
    """A Literal, as ruff would format it."""
    quoted = [f'"{value}"' for value in values]
    if sum(map(len, quoted)) < 60:
        return f"Literal[{', '.join(quoted)}]"
    return "Literal[\n" + "".join(f"    {word},\n" for word in quoted) + "]"
