"""Messages of the daemon's sockets for programs that are not ours: JSON Schemas, and Python types.

Made from `daemon/protocol/`, so that there is one definition, by `make reference`; so is the schema
of `simulation.yaml`.
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
from simulator.truth import SimulationFile

#: Each with all that it holds: Status and Snapshot are in a reply.
SCHEMAS: Final[dict[str, Any]] = {
    "request": Request, "reply": Reply, "state": State, "simulation": SimulationFile,
}  # fmt: skip
WIDTH: Final = 100

REQUESTS_HEAD: Final = '''"""Requests to the daemon's sockets, as the dictionaries that JSON makes.

Made from the code by `make reference`: change them in `daemon/protocol/`.
"""

from typing import Literal, NotRequired, TypedDict
'''
MESSAGES_HEAD: Final = '''"""Messages of the daemon's sockets, as the dictionaries that JSON makes.

Made from the code by `make reference`: change them in `daemon/protocol/`. A key that is
NotRequired may be missing. Vectors are in the order of `Snapshot.joints`, SI at the link side.
"""
# ruff: noqa: PLC0414 - other programs take all names from here

from typing import Any, Final, Literal, NotRequired, TypedDict

from contactd_client.requests import Command as Command
from contactd_client.requests import GuideAxes as GuideAxes
from contactd_client.requests import Header as Header
from contactd_client.requests import Request as Request
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
    """Patterns as ECMA 262 has them: the end of the text is $ there, and \\Z means nothing. Whole
    numbers without a point: `typing` takes a bound of 7 for one of 7.0 that it met before."""
    match value:
        case dict():
            return {
                key: _pattern(inner) if key == "pattern" else _portable(inner)
                for key, inner in value.items()
            }
        case list():
            return [_portable(inner) for inner in value]
        case float() if value.is_integer():
            return int(value)
    return value


def _pattern(text: str) -> str:
    return text.removesuffix(r"\Z") + "$" if text.endswith(r"\Z") else text


def client_requests() -> str:
    """contactd_client/requests.py: a TypedDict for all requests, and one for what they hold."""
    held = [cls for cls in _ordered(Request) if cls not in get_args(Request)]
    dicts = [*map(_typed_dict, held), _request_dict()]
    return _module(REQUESTS_HEAD, [f"Command = {_literal(COMMANDS)}"], dicts)


def client_messages() -> str:
    """contactd_client/messages.py: a TypedDict for each message."""
    requests = _ordered(Request)
    dicts = [_typed_dict(cls) for cls in _ordered(Reply, State) if cls not in requests]
    names = [f"STATE_FORMAT: Final = {STATE_FORMAT}", f"Mode = {_literal([*Mode])}"]
    return _module(MESSAGES_HEAD, names, dicts)


def _module(head: str, names: list[str], dicts: list[str]) -> str:
    return "\n".join([head, *names, "", *(f"\n{made}" for made in dicts)])


def _ordered(*messages: Any) -> list[type]:
    """Structs of the messages, each behind all that it holds."""
    ordered: dict[type, None] = {}
    for message in messages:
        for member in members(message):
            _add(member, ordered)
    return list(ordered)


def members(cls: Any) -> tuple[type, ...]:
    """Structs of a union; of a struct, itself."""
    return get_args(cls) or (cls,)


def _request_dict() -> str:
    """TypedDict of all requests, whose fields say which commands take them."""
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
        lines += _field(f"{name}: NotRequired[{_annotation(kind)}]", comment)
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
        kind = _annotation(field.type)
        annotated = f"{field.name}: {kind if field.required else f'NotRequired[{kind}]'}"
        lines += _field(annotated, said.get(field.name, ""))
    return "\n".join([*lines, ""])


def _field(annotated: str, comment: str) -> list[str]:
    """Lines of a field: its comment beside it, above it where that is too long."""
    beside = f"    {annotated}  # {comment}" if comment else f"    {annotated}"
    if len(beside) <= WIDTH:
        return [beside]
    above = textwrap.wrap(comment, WIDTH - 6)
    return [*(f"    # {line}" for line in above), f"    {annotated}"]


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
        case types.ListType() | types.VarTupleType():
            return f"list[{_annotation(kind.item_type)}]"
        case types.Metadata():  # bounds for the schema
            return _annotation(kind.type)
        case types.DictType():
            return f"dict[{_annotation(kind.key_type)}, {_annotation(kind.value_type)}]"
    raise NotImplementedError(kind)


def _literal(values: Any) -> str:
    """A Literal, on as few lines as it takes."""
    words = ", ".join(f'"{value}"' for value in values)
    if len(words) < 60:
        return f"Literal[{words}]"
    packed = textwrap.fill(f"{words},", WIDTH, initial_indent="    ", subsequent_indent="    ")
    return f"Literal[\n{packed}\n]  # fmt: skip"
