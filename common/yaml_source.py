"""Strict YAML reader: no duplicate keys, no NaN, numbers as in YAML 1.2, and the line of every
value."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from common.errors import ConfigurationError
from common.regular_file import read_text


class _StrictLoader(yaml.SafeLoader):
    """Loader without the pitfalls of YAML 1.1. By default PyYAML reads `1e-3` as text, `off` as a
    boolean, `010` as 8 and `2:00` as 120, and silently takes the last of two equal keys; none of
    this may happen to a limit."""

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [
            (tag, pattern)
            for tag, pattern in resolvers
            if tag.rpartition(":")[2] not in ("bool", "int", "float")
        ]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: dict[Any, int] = {}
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            line = key_node.start_mark.line + 1
            if not isinstance(key, str):
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key!r} must be text (put it in quotes)", key_node.start_mark
                )
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None,
                    None,
                    f"key `{key}` is given twice, first in line {seen[key]}",
                    key_node.start_mark,
                )
            seen[key] = line
        return super().construct_mapping(node, deep)

    def construct_finite(self, node: yaml.ScalarNode) -> float:
        text = self.construct_scalar(node)
        value = float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
        if not math.isfinite(value):
            raise yaml.constructor.ConstructorError(
                None, None, f"{text} is not allowed, numbers must be finite", node.start_mark
            )
        return value


_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"^(?:true|false)$"), list("tf")
)
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:int",
    re.compile(r"^(?:[-+]?(?:0|[1-9][0-9]*)|0x[0-9a-fA-F]+)$"),
    list("-+0123456789"),
)
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"^[-+]?(?:(?:\.[0-9]+|[0-9]+\.[0-9]*)(?:[eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+"
        r"|\.(?:inf|Inf|INF|nan|NaN|NAN))$"
    ),
    list("-+0123456789."),
)
_StrictLoader.add_constructor("tag:yaml.org,2002:float", _StrictLoader.construct_finite)


@dataclass(frozen=True, slots=True)
class Source:
    """YAML file as plain data, with the line of every value."""

    path: Path
    text: str
    data: Any
    root: yaml.Node

    def line(self, keys: list[str | int]) -> int:
        """Line of the value at the path `keys`, or of the deepest part of that path that exists."""
        return int(self.node(keys).start_mark.line) + 1

    def node(self, keys: list[str | int]) -> yaml.Node:
        """Node of the value at the path `keys`, or of the deepest part of that path that exists."""
        node: yaml.Node = self.root
        for key in keys:
            found: yaml.Node | None = None
            if isinstance(node, yaml.MappingNode):
                found = next((v for k, v in node.value if k.value == key), None)
            elif isinstance(node, yaml.SequenceNode) and isinstance(key, int):
                found = node.value[key] if key < len(node.value) else None
            if found is None:
                break
            node = found
        return node


def quoted(text: str) -> str:
    """Text in double quotes that YAML reads back unchanged, whatever it contains."""
    return '"' + "".join(map(_in_quotes, text)) + '"'


def _in_quotes(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    return character if character.isprintable() else f"\\U{ord(character):08X}"


def read_yaml(path: Path) -> Source:
    """Read one file. Raises ConfigurationError with file, line and reason."""
    try:
        text = read_text(path)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: is not UTF-8 text: {error}") from error
    return parse_yaml(text, path)


def parse_yaml(text: str, path: Path) -> Source:
    """Parse a text; `path` is only used in messages. Raises ConfigurationError."""
    try:
        loader = _StrictLoader(text)
        root = loader.get_single_node()
        data = None if root is None else loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        raise ConfigurationError(f"{path}:{_explained(error)}") from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        what = f"the character U+{ord(text[error.position]):04X} is not allowed"
        raise ConfigurationError(f"{path}:{line}: {what}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: is not valid YAML: {error}") from error
    if root is None:
        raise ConfigurationError(f"{path}: is empty")
    return Source(path, text, data, root)


# PyYAML's message (a pattern), whether the line to report is the one where the faulty construct
# began, and the message to the user.
_WORDS: Final = (
    (r"mapping values are not", False, "`: ` where no name is expected: put text that holds it in "
     "quotes, and indent the lines of a group alike"),
    (r"sequence entries are not", False, "`- ` begins an entry of a list, on a line of its own"),
    (r"expected ',' or '(.)'", True, "a bracket is not closed by `{}` before the next name"),
    (r"found character '\\t'", False, "a tab: indent with spaces"),
    (r"found character '(.)'", False, "text that begins with `{}` must be in quotes"),
    (r"found unexpected end of", True, "a quote is not closed"),
    (r"could not find expected ':'", True, "`NAME: VALUE` is expected"),
    (r"expected <block end>", False, "not in line with its group: check the indentation, and that "
     "quotes are closed above"),
    (r"found undefined alias '(.+)'", False, "`*{0}` without `&{0}` before it; text that begins "
     "with `*` must be in quotes"),
    (r"could not determine a constr", False, "text that begins with `!` must be in quotes"),
    (r"expected alphabetic or num", True, "text that begins with `*` or `&` must be in quotes"),
    (r"but found another document", False, "`---` begins a second document, only one is allowed"),
    (r"found unknown escape char.+'(.)'", False, "`\\{}` is no escape: use single quotes"),
)  # fmt: skip


def _explained(error: yaml.MarkedYAMLError) -> str:
    """Line of an error, and its cause in the terms of the file's author instead of the parser's."""
    problem, mark = error.problem or str(error), error.problem_mark
    for pattern, at_beginning, words in _WORDS:
        if found := re.match(pattern, problem):
            mark = error.context_mark if at_beginning else mark
            problem = words.format(*found.groups())
            break
    return f"{mark.line + 1}: {problem}" if mark else f" {problem}"
