"""Loading of a robot: from its files to a checked `Configuration`.

Every error names file, line, path in the file, value and what is allowed.
"""

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from daemon.config.checks import cross_checks
from daemon.config.identified import Identified, applied, identified_keys, identified_text
from daemon.config.motion import recorded_path
from daemon.config.problem import Problem
from daemon.config.schema import Configuration
from daemon.config.yaml_source import Source, parse_yaml, read_yaml
from daemon.motion.sampled_path import SampledPath
from errors import ConfigurationError, TrajectoryError
from regular_file import read_text

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
_SIGNS = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below"}
_SOME = "…"
LONGEST = 60  # characters of a wrong value that are shown
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")


@dataclass(frozen=True, slots=True)
class Robot:
    """One arm's folder, read and checked."""

    path: Path  # of config.yaml
    configuration: Configuration
    text: str  # of config.yaml
    urdf: str  # text of the URDF
    recorded: SampledPath | None = None  # of trajectory.file
    identified: Identified | None = None  # its values are in `configuration` already
    identified_text: str = ""  # of identified.yaml
    by_hand: Configuration | None = None  # as written in config.yaml, where the two differ

    @property
    def folder(self) -> Path:
        """Folder that paths in the configuration are relative to."""
        return self.path.parent

    def place(self) -> Path:
        """Absolute path of config.yaml, for processes in other folders; asks the file system. A
        link in the place of config.yaml is kept: its files lie beside the link."""
        return self.folder.resolve() / self.path.name

    def in_words(self, problem: Problem) -> str:
        """A problem with file and line of its value: config.yaml, or identified.yaml where the
        value was identified."""
        path, text = self.path, self.text
        keys = identified_keys(problem.keys, self.configuration, self.identified)
        if keys:
            path, text = self.folder / self.configuration.identified, self.identified_text
        line = parse_yaml(text, path).line(keys or problem.keys)
        return f"{path}:{line}: {problem.where}: {problem.what}"

    def with_port(self, port: int | None) -> "Robot":
        """Copy of the robot on another TCP port; the robot itself if `port` is None."""
        if port is None:
            return self
        bus = msgspec.structs.replace(self.configuration.bus, port=port)
        return replace(self, configuration=msgspec.structs.replace(self.configuration, bus=bus))


def load_robot(path: Path) -> Robot:
    """Read `config.yaml` (or the folder that holds it) and everything it refers to.

    Raises ConfigurationError; types stop at the first error, cross-checks list all.
    """
    if os.path.isdir(path):  # false also if its folder may not be searched
        path = path / "config.yaml"
    source = read_yaml(path)
    configuration = convert(source, Configuration)
    urdf_path = path.parent / configuration.urdf
    try:
        urdf = read_text(urdf_path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            f"{path}:{source.line(['urdf'])}: urdf: {urdf_path} cannot be read: {error}"
        ) from error
    if findings := cross_checks(configuration, urdf, path.parent):
        robot = Robot(path, configuration, source.text, urdf)
        raise ConfigurationError("\n".join(robot.in_words(finding) for finding in findings))
    try:
        recorded = recorded_path(configuration, path.parent)
    except TrajectoryError as error:
        where = f"{path}:{source.line(['trajectory', 'file'])}: trajectory.file"
        raise ConfigurationError(f"{where}: {error}") from error
    return _with_identified(Robot(path, configuration, source.text, urdf, recorded))


def _with_identified(robot: Robot) -> Robot:
    """Robot with the values of identified.yaml, if there is one, in place of hand-written ones."""
    path = robot.folder / robot.configuration.identified
    if not os.path.lexists(path):  # a link to nowhere is no reason to go on without
        return robot
    return _with(robot, read_yaml(path))


def refuse_unreadable(robot: Robot, found: Identified) -> None:
    """Raises ConfigurationError where identified.yaml with `found` would be refused when it is
    read: a daemon would not begin with it."""
    path = robot.folder / robot.configuration.identified
    source = parse_yaml(identified_text(found), path)
    try:
        _with(replace(robot, configuration=robot.by_hand or robot.configuration), source)
    except ConfigurationError as error:
        raise ConfigurationError(
            f"what was found is not written, it is not allowed: {error}"
        ) from error


def _with(robot: Robot, source: Source) -> Robot:
    """Robot with the values of the identified.yaml of `source`. Raises ConfigurationError."""
    text, found = _identified(source, robot.configuration)
    robot = replace(
        robot,
        configuration=applied(robot.configuration, found),
        identified=found,
        identified_text=text,
        by_hand=robot.configuration,
    )
    if findings := cross_checks(robot.configuration, robot.urdf, robot.folder):
        raise ConfigurationError("\n".join(robot.in_words(finding) for finding in findings))
    return robot


def _identified(source: Source, configuration: Configuration) -> tuple[str, Identified]:
    found = convert(source, Identified)
    for name in found.joints:
        if name not in configuration.joint_names:
            line = source.line(["joints", name])
            known = ", ".join(configuration.joint_names)
            raise ConfigurationError(
                f"{source.path}:{line}: joints: no joint {name}; there are: {known}"
            )
    return source.text, found


def parse_configuration(text: str, name: str, identified: str = "") -> Configuration:
    """Configuration from the text of `config.yaml` and, where there was one, of `identified.yaml`.

    `name` is for messages. Raises ConfigurationError. There are no cross-checks.
    """
    configuration = convert(parse_yaml(text, Path(name)), Configuration)
    if identified:
        found = _identified(parse_yaml(identified, Path(f"{name}, identified")), configuration)[1]
        configuration = applied(configuration, found)
    return configuration


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
        unknown = re.search(r"unknown field `(.+)`", message)
        if unknown:
            line = source.line([*keys, unknown.group(1)])
            known = ", ".join(_fields_at(kind, keys))
            message = f"unknown key `{unknown.group(1)}`" + (
                f" (allowed: {known})" if known else ""
            )
        else:
            line = source.line(keys)
            message = _plain(message)
            if of_a_key:
                message += " as a key"
            if choices := _choices_at(kind, keys, of_a_key):
                allowed = ", ".join(choices)
                if message.startswith(_NO_CHOICE) and not of_a_key:
                    message = f"must be one of {allowed}, not {message.removeprefix(_NO_CHOICE)}"
                else:
                    message += f" (allowed: {allowed})"
            else:
                message += _value_at(keys, source.data)
        raise ConfigurationError(f"{source.path}:{line}: {place}: {message}") from error


def _plain(message: str) -> str:
    """msgspec's message without Python's names of types: `must be a number above 0`."""
    found = _EXPECTED.fullmatch(message)
    if found is None:
        return message[:1].lower() + message[1:]
    kinds, length, sign, bound, got = found.groups()
    words = " or ".join(_KINDS.get(kind, kind) for kind in kinds.split(" | "))
    if bound is not None:
        words += f"{' of length' if length else ''} {_SIGNS[sign]} {bound.removesuffix('.0')}"
    # What has a short value is shown by that.
    return f"must be {words}" + (f", not {_KINDS[got]}" if got in _UNSHOWN else "")


def _keys(where: str) -> list[str | int]:
    """Steps of msgspec's `.joints[2].limits`; it writes `[...]` for 'some key of this mapping'."""
    return [
        name or (_SOME if index == "..." else int(index)) for name, index in _STEP.findall(where)
    ]


def _named(keys: list[str | int], data: Any, kind: Any, message: str) -> list[str | int]:
    """Keys of which each is a name: of a mapping the first whose value alone is refused so."""
    found: list[str | int] = []
    for key in keys:
        inside = _walk(found, data) if key == _SOME else None
        names = iter(inside) if isinstance(inside, dict) else ()
        refused = (name for name in names if _refused(_only(data, found, name), kind, message))
        found.append(next(refused, key))
    return found


def _only(data: Any, keys: list[str | int], key: str) -> Any:
    """Data whose mapping behind `keys` has this key alone."""
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
    if isinstance(value, str):  # of a file that is something else it may be all of it
        return f", not {value if len(value) <= LONGEST else value[:LONGEST] + _SOME!r}"
    return f", not {value!r}" if isinstance(value, (int, float)) else ""


def _spell(keys: list[str | int], data: Any) -> str:
    """Path such as `joints[2] (LElbowRoll).limits.velocity`: entries are named, for people."""
    text = ""
    for depth, key in enumerate(keys):
        if isinstance(key, int):
            entry = _walk(keys[: depth + 1], data)
            name = entry.get("name") if isinstance(entry, dict) else None
            text += f"[{key}]" + (f" ({name})" if isinstance(name, str) else "")
        else:
            text += ("." if text else "") + key
    return text


def _type_at(kind: Any, keys: list[str | int]) -> Any:
    """Type expected at the end of `keys`, as msgspec describes it."""
    node: Any = msgspec.inspect.type_info(kind)
    for key in keys:
        node = _struct_of(node)
        if isinstance(node, msgspec.inspect.StructType):
            node = next((f.type for f in node.fields if f.encode_name == key), None)
        elif isinstance(node, msgspec.inspect.DictType):
            node = node.value_type
        elif isinstance(node, (msgspec.inspect.ListType, msgspec.inspect.VarTupleType)):
            node = node.item_type
    return _struct_of(node)


def _struct_of(node: Any) -> Any:
    """Struct among the choices of a union, where there is one."""
    if isinstance(node, msgspec.inspect.UnionType):
        return next((t for t in node.types if hasattr(t, "fields")), node)
    return node


def _fields_at(kind: Any, keys: list[str | int]) -> list[str]:
    """Names that are allowed at the end of `keys`."""
    node = _type_at(kind, keys)
    return [f.encode_name for f in node.fields] if hasattr(node, "fields") else []


def _choices_at(kind: Any, keys: list[str | int], of_a_key: bool) -> list[str]:
    """Values, or keys, that are allowed at the end of `keys`; empty if they are no list."""
    node = _type_at(kind, keys)
    if of_a_key:
        node = node.key_type
    if isinstance(node, msgspec.inspect.EnumType):
        return [str(choice.value) for choice in node.cls]
    return [str(choice) for choice in getattr(node, "values", ())]
