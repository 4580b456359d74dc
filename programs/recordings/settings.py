"""Changes of a recorded configuration: `PATH=VALUE`, as `contactd whatif --set` takes them.

PATH is the path of a setting, with joints by name: `estimator.gain=20`,
`joints.LElbowYaw.friction.motor_coulomb=0.4`. `identified=FILE` uses another identified.yaml, and
`payload=VALUE` sets the payload in the hand (`replayed_payload`). VALUE is YAML.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, get_type_hints

import msgspec
import yaml

from common.errors import ConfigurationError
from common.regular_file import read_text
from daemon.config.load import parse_configuration
from daemon.config.schema import Configuration
from daemon.protocol.state import Snapshot
from daemon.protocol.text import printable

IDENTIFIED: Final = "identified"
PAYLOAD: Final = "payload"
REPLAYED: Final = ("estimator", "joints", "payloads")
"""Sections of a configuration that a replay uses."""
_EXPONENT: Final = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+", re.ASCII)
Change = tuple[str, str]
"""PATH and VALUE."""


def parse_change(text: str) -> Change:
    """PATH and VALUE from `PATH=VALUE`; for `identified` VALUE is the file's text. Raises
    ConfigurationError."""
    path, equals, value = text.partition("=")
    if not (path and equals and value):
        raise ConfigurationError(f"--set {printable(text)}: must be PATH=VALUE")
    if path == IDENTIFIED:
        try:
            return path, read_text(Path(value))
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigurationError(f"--set {text}: cannot read {value}: {error}") from error
    return path, value


def changed_configuration(snapshot: Snapshot, changes: Sequence[Change]) -> Configuration:
    """Recorded configuration with these changes applied in order. Raises ConfigurationError."""
    identified = next(
        (value for path, value in reversed(changes) if path == IDENTIFIED), snapshot.identified
    )
    configuration = parse_configuration(
        snapshot.configuration, "the recorded configuration", identified
    )
    for path, value in changes:
        if path not in (IDENTIFIED, PAYLOAD):
            keys, parsed = path.split("."), parsed_value(path, value)
            try:
                configuration = _with(configuration, keys, parsed, path)
            except msgspec.ValidationError as error:
                raise ConfigurationError(f"{as_option(path, value)}: {error}") from error
            if keys[0] not in REPLAYED:
                raise ConfigurationError(
                    f"{as_option(path, value)}: has no effect: a replay uses only "
                    f"{', '.join(REPLAYED)}, {IDENTIFIED} and {PAYLOAD}"
                )
    if configuration.joint_names != snapshot.joints:
        raise ConfigurationError("--set: names of joints cannot be changed")
    return configuration


def parsed_value(path: str, value: str) -> Any:
    """Parsed VALUE of a change; 1e-3 is a number, although YAML reads it as text. Raises
    ConfigurationError."""
    if _EXPONENT.fullmatch(value.strip()):
        return float(value)
    try:
        return yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{as_option(path, value)}: is not valid YAML") from error


def _with(place: Any, keys: Sequence[str], value: Any, path: str) -> Any:
    """Copy of `place` with another value under these keys. Raises ConfigurationError for an unknown
    key, msgspec.ValidationError for a value of another type."""
    key, *rest = keys
    if isinstance(place, msgspec.Struct) and key in place.__struct_fields__:
        before, kind = getattr(place, key), get_type_hints(type(place), include_extras=True)[key]
        after = _with(before, rest, value, path) if rest else msgspec.convert(value, kind)
        return msgspec.structs.replace(place, **{key: after})
    if isinstance(place, list | tuple) and (index := _index(place, key)) is not None:
        before = place[index]
        after = _with(before, rest, value, path) if rest else msgspec.convert(value, type(before))
        return type(place)([*place[:index], after, *place[index + 1 :]])
    if isinstance(place, dict) and key in place:
        after = (
            _with(place[key], rest, value, path)
            if rest
            else msgspec.convert(value, type(place[key]))
        )
        return {**place, key: after}
    known = _keys(place)
    there = f"there are: {', '.join(known)}" if known else "there is nothing below"
    raise ConfigurationError(f"--set {printable(path)}: no setting {printable(key)!r}; {there}")


def _index(place: Sequence[Any], key: str) -> int | None:
    """Index of an element by its name, or by its number from 0; None if there is none."""
    for k, one in enumerate(place):
        if getattr(one, "name", None) == key:
            return k
    return int(key) if key.isdecimal() and int(key) < len(place) else None


def _keys(place: Any) -> list[str]:
    if isinstance(place, msgspec.Struct):
        return list(place.__struct_fields__)
    if isinstance(place, list | tuple):
        return [str(getattr(one, "name", k)) for k, one in enumerate(place)]
    return list(place) if isinstance(place, dict) else []


def as_option(path: str, value: str) -> str:
    """Change as the user gave it, for error messages."""
    return f"--set {printable(path)}={printable(value)[:80]}"
