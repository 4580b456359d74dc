"""Conversion of plain data to an object of the schema; an error names file, line, path, value and
what is allowed."""

import re
from typing import Any, TypeVar

import msgspec

from common.errors import ConfigurationError
from common.yaml_source import Source

T = TypeVar("T", bound=msgspec.Struct)
# msgspec says "at `key` in `$.drives[...].rpdo`" of a mapping's key, "at `$.bus.port`" of a value.
_OF_A_KEY = "key` in `"
# msgspec: "Expected `float` > 0.0", "Expected `array` of length >= 1", "Expected `int`, got `str`".
_EXPECTED = re.compile(r"Expected `(.+?)`(?:( of length)? (>=|<=|>|<) (\S+))?(?:, got `(.+)`)?")
_KINDS = {
    "float": "a number", "int": "a whole number", "str": "text", "bool": "`true` or `false`",
    "array": "a list", "object": "a group of fields", "null": "nothing",
}  # fmt: skip
_UNSHOWN = ("array", "object", "null")
_NO_CHOICE = "invalid enum value "
_UNKNOWN = {False: r"unknown field `(.+)`", True: r"Invalid enum value '(.+)'"}  # by `of_a_key`
_SIGNS = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below"}
_SOME = "…"
LONGEST = 60  # characters of a wrong value that are shown
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")


def convert(source: Source, kind: type[T]) -> T:
    """Plain data as an object of `kind`.

    An integer may stand for a float; nothing else is coerced. Raises ConfigurationError: msgspec's
    message with file, line, path, value and what is allowed.
    """
    try:
        return msgspec.convert(source.data, kind)
    except msgspec.ValidationError as error:
        message, _, where = str(error).partition(" - at `")
        of_a_key = where.startswith(_OF_A_KEY)
        keys = _keys(where.removeprefix(_OF_A_KEY).rstrip("`"))
        keys = _named(keys, source.data, kind, str(error))
        place = _spell(keys, source.data) or "the file"
        unknown = re.search(_UNKNOWN[of_a_key], message)
        if unknown:
            line = source.line([*keys, unknown.group(1)])
            node = _type_at(kind, keys, source.data)
            known = _choices_of(node, of_a_key) if of_a_key else _fields_of(node)
            tag = getattr(node, "tag_field", None)
            if tag and source.node([*keys, tag]) is source.node(keys):  # the file has no tag
                makes = _choices_of(_type_at(kind, [*keys, tag], source.data), False)
                known += [f"{tag}: {one}" for one in makes]
            message = f"unknown key `{unknown.group(1)}` (allowed: {', '.join(known)})"
        else:
            line = source.line(keys)
            message, node = _plain(message), _type_at(kind, keys, source.data)
            if of_a_key:
                message += " as a key"
            unit = (getattr(node, "extra", None) or {}).get("unit")
            if unit and message[-1].isdigit():  # a bound
                message += f" {unit}"
            if choices := _choices_of(node, of_a_key):
                allowed = ", ".join(choices)
                if message.startswith(_NO_CHOICE):
                    one = "one of " if len(choices) > 1 else ""
                    message = f"must be {one}{allowed}, not {message.removeprefix(_NO_CHOICE)}"
                else:
                    message += f" (allowed: {allowed})"
            else:
                message += _value_at(keys, source.data)
                if str(source.node(keys).value).startswith("0x"):
                    message = re.sub(r"\d+", lambda number: hex(int(number[0])), message)
        raise ConfigurationError(f"{source.path}:{line}: {place}: {message}") from error


def _plain(message: str) -> str:
    """msgspec's message without Python type names: `must be a number above 0`."""
    found = _EXPECTED.fullmatch(message)
    if found is None:
        return message[:1].lower() + message[1:]
    kinds, length, sign, bound, got = found.groups()
    words = " or ".join(_KINDS.get(kind, kind) for kind in kinds.split(" | "))
    words = words.replace(_KINDS["null"], "left out")
    if bound is not None:
        words += f" {_SIGNS[sign]} {bound.removesuffix('.0')}"
        one, more = ("character", "characters") if kinds == "str" else ("entry", "entries")
        words += f" {one if bound == '1' else more}" if length else ""
    # Values of other types are short, and shown by `_value_at`.
    return f"must be {words}" + (f", not {_KINDS[got]}" if got in _UNSHOWN else "")


def _keys(where: str) -> list[str | int]:
    """Keys of msgspec's path `.joints[2].limits`, where `[...]` is some key of the mapping."""
    return [
        name or (_SOME if index == "..." else int(index)) for name, index in _STEP.findall(where)
    ]


def _named(keys: list[str | int], data: Any, kind: Any, message: str) -> list[str | int]:
    """Keys with every placeholder replaced by the first key of the mapping whose entry alone causes
    the same error."""
    found: list[str | int] = []
    for key in keys:
        inside = _walk(found, data) if key == _SOME else None
        names = iter(inside) if isinstance(inside, dict) else ()
        refused = (name for name in names if _refused(_only(data, found, name), kind, message))
        found.append(next(refused, key))
    return found


def _only(data: Any, keys: list[str | int], key: str) -> Any:
    """Copy of the data in which the mapping at `keys` has this key only."""
    if not keys:
        return {key: data[key]}
    copy: Any = dict(data) if isinstance(data, dict) else list(data)
    copy[keys[0]] = _only(data[keys[0]], keys[1:], key)
    return copy


def _refused(data: Any, kind: Any, message: str) -> bool:
    try:
        msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        return str(error) == message
    return False


def _walk(keys: list[str | int], data: Any) -> Any:
    for key in keys:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _value_at(keys: list[str | int], data: Any) -> str:
    value = _walk(keys, data)
    if isinstance(value, bool):
        return f", not {str(value).lower()}"
    if isinstance(value, str):  # may be long: the whole text of a file of another kind
        return f", not {value if len(value) <= LONGEST else value[:LONGEST] + _SOME!r}"
    return f", not {value!r}" if isinstance(value, (int, float)) else ""


def _spell(keys: list[str | int], data: Any) -> str:
    """Path such as `joints[2] (LElbowRoll).limits.velocity`, with the names of entries."""
    text = ""
    for depth, key in enumerate(keys):
        if isinstance(key, int):
            entry = _walk(keys[: depth + 1], data)
            name = entry.get("name") if isinstance(entry, dict) else None
            text += f"[{key}]" + (f" ({name})" if isinstance(name, str) else "")
        else:
            text += ("." if text else "") + key
    return text


def _type_at(kind: Any, keys: list[str | int], data: Any = None) -> Any:
    """Type expected at `keys`, as msgspec describes it; of a union, the member that fits `data`."""
    node: Any = msgspec.inspect.type_info(kind)
    for key in keys:
        tags = [t.tag for t in getattr(node, "types", ()) if getattr(t, "tag_field", None) == key]
        node = _struct_of(node, data)
        if tags:
            node = msgspec.inspect.LiteralType(tuple(tags))
        elif isinstance(node, msgspec.inspect.StructType):
            node = next((f.type for f in node.fields if f.encode_name == key), None)
        elif isinstance(node, msgspec.inspect.DictType):
            node = node.value_type
        elif isinstance(node, (msgspec.inspect.ListType, msgspec.inspect.VarTupleType)):
            node = node.item_type
        elif isinstance(node, msgspec.inspect.TupleType) and isinstance(key, int):
            node = node.item_types[key]
        data = _walk([key], data)
    return _struct_of(node, data)


def _struct_of(node: Any, data: Any) -> Any:
    """Struct among the members of a union, if any: preferably the one with the tag of `data`."""
    if not isinstance(node, msgspec.inspect.UnionType):
        return node
    structs = [t for t in node.types if isinstance(t, msgspec.inspect.StructType)]
    tagged = (t for t in structs if t.tag_field and _walk([t.tag_field], data) == t.tag)
    return next(tagged, structs[0] if structs else node)


def _fields_of(node: Any) -> list[str]:
    """Names of the fields of a struct."""
    return [f.encode_name for f in node.fields] if hasattr(node, "fields") else []


def choices(kind: Any, path: str) -> list[str]:
    """Allowed values of a field, or allowed keys of a mapping; empty if they are not enumerated.
    The path has no indices or user-defined names: `joints.end`."""
    keys: list[str | int] = []
    for name in path.split("."):
        while hasattr(inside := _type_at(kind, keys), "item_type") or hasattr(inside, "value_type"):
            keys.append(0)
        keys.append(name)
    node = _type_at(kind, keys)
    return _choices_of(node, isinstance(node, msgspec.inspect.DictType))


def _choices_of(node: Any, of_a_key: bool) -> list[str]:
    """Values, or keys, that a type allows; empty if they are not enumerated."""
    if of_a_key:
        node = node.key_type
    if isinstance(node, msgspec.inspect.EnumType):
        return [str(choice.value) for choice in node.cls]
    return [str(choice) for choice in getattr(node, "values", ())]
