"""Recordings with damaged messages: one clear error, no traceback."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from bench.rigs.lockstep import SINGLE_JOINT, lockstep_rig
from common.errors import ContactdError, LogError
from daemon.config.load import load_robot
from daemon.protocol.state import Snapshot, State
from daemon.service.status import snapshot_of
from programs.clients.log_reader import PROFILE, read_log
from programs.clients.replay import replay
from programs.contactd.contactd import main
from programs.identify.measured import read_measured
from tests.examples import scaled


def _recorded() -> list[tuple[str, bytes]]:
    """Topic and data of each message of a recording of twenty ticks."""
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.run(0.4)
        messages: list[tuple[str, Snapshot | State]] = [
            ("/snapshot", snapshot_of(rig.robot, rig.tick))
        ]
        messages += [("/state", state) for state in rig.states(0.2)]
    return [(topic, msgspec.json.encode(message)) for topic, message in messages]


MESSAGES = _recorded()
CONFIGURATION = load_robot(SINGLE_JOINT).configuration
HUGE = 10**400


def written(path: Path, messages: list[tuple[str, bytes]]) -> Path:
    with path.open("wb") as stream:
        log = Writer(stream)
        log.start(profile=PROFILE)
        schema = log.register_schema("any", "jsonschema", b"{}")
        channels = {topic: log.register_channel(topic, "json", schema) for topic, _ in messages}
        for k, (topic, data) in enumerate(messages):
            log.add_message(channels[topic], log_time=k, publish_time=k, data=data)
        log.finish()
    return path


def changed(topic: str, change: Callable[[Any], None], which: int = 0) -> list[tuple[str, bytes]]:
    """The recording with one message of `topic` changed."""
    messages = list(MESSAGES)
    k = [i for i, (of, _) in enumerate(messages) if of == topic][which]
    plain = json.loads(messages[k][1])
    change(plain)
    messages[k] = (topic, json.dumps(plain).encode())
    return messages


def set_to(*keys: Any, value: Any) -> Callable[[Any], None]:
    def change(plain: Any) -> None:
        for key in keys[:-1]:
            plain = plain[key]
        plain[keys[-1]] = value

    return change


DAMAGE = {
    "a huge integer in the memory": (
        "/snapshot",
        set_to("memory", "alignment", "count", value=HUGE),
        "count: Python int too large",
    ),
    "an integer beyond 64 bits in the memory": (
        "/snapshot",
        set_to("memory", "motor_position", "streak", value=[10**30]),
        "streak: Python int too large",
    ),
    "a huge integer for a float in the memory": (
        "/snapshot",
        set_to("memory", "kernel", "elapsed_s", value=HUGE),
        "elapsed_s: int too large",
    ),
    "no memory": ("/snapshot", set_to("memory", "kernel", value=7), "memory"),
    "ragged samples": ("/state", set_to("current", value=[0.1, 0.2]), "2 values of current"),
    "no samples": ("/state", set_to("link_position", value=[]), "0 values of link_position"),
    "no side": ("/state", set_to("side", value=[]), "0 values of side"),
    "a huge number": ("/state", set_to("current", value=[HUGE]), "out of range"),
}


@pytest.mark.parametrize("name", list(DAMAGE))
def test_a_damaged_message_is_one_error(tmp_path: Path, name: str) -> None:
    topic, change, word = DAMAGE[name]
    path = written(tmp_path / "made.mcap", changed(topic, change))
    with pytest.raises(ContactdError, match=word):
        replay(path)
    result = CliRunner().invoke(main, ["replay", str(path)])
    assert result.exit_code not in (0, 1)
    (line,) = result.stderr.splitlines()
    assert line.startswith("contactd: ")
    assert len(line) < 400


def test_states_before_ragged_samples_are_replayed(tmp_path: Path) -> None:
    change = set_to("current", value=[0.1, 0.2])
    path = written(tmp_path / "made.mcap", changed("/state", change, which=10))
    result = replay(path)
    assert "2 values of current for 1 joints" in result.broken
    assert "10 states read" in result.broken
    with pytest.raises(LogError, match="too short"):
        read_measured([path], CONFIGURATION)


def test_a_state_without_a_snapshot_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "made.mcap", [m for m in MESSAGES if m[0] == "/state"])
    with pytest.raises(LogError, match="for 0 joints"):
        list(read_log(path))


@pytest.mark.parametrize("topic", ["/snapshot", "/state"])
def test_a_key_twice_is_refused(tmp_path: Path, topic: str) -> None:
    messages = [
        (of, data.replace(b"{", b'{"tick": 0, ', 1) if of == topic else data)
        for of, data in MESSAGES
    ]
    with pytest.raises(LogError, match="key `tick` is given twice"):
        list(read_log(written(tmp_path / "made.mcap", messages)))


def test_text_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    messages = [(of, data.replace(b'"gap"', b'"g\xffp"')) for of, data in MESSAGES]
    assert messages != MESSAGES
    with pytest.raises(LogError, match="of another version"):
        list(read_log(written(tmp_path / "made.mcap", messages)))


NASTY = st.one_of(
    st.integers(min_value=-(10**40), max_value=10**40),
    st.sampled_from([HUGE, -HUGE, 1e308, -1e308, 0, -1, None, True, "", "x" * 5000, [], {}]),
    st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=3),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)


def places(plain: Any, way: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inside = plain.items() if isinstance(plain, dict) else enumerate(plain)
    found = []
    for key, value in inside:
        found.append((*way, key))
        if isinstance(value, (dict, list)):
            found += places(value, (*way, key))
    return found


@settings(max_examples=scaled(150))
@given(data=st.data())
def test_any_value_in_any_place_ends_in_a_result_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    topic = data.draw(st.sampled_from(["/snapshot", "/state"]))
    plain = json.loads(next(found for of, found in MESSAGES if of == topic))
    place = data.draw(st.sampled_from(places(plain)))
    value = data.draw(NASTY)
    path = tmp_path_factory.mktemp("damaged") / "made.mcap"
    written(path, changed(topic, set_to(*place, value=value)))
    for work in (lambda: replay(path), lambda: read_measured([path], CONFIGURATION)):
        try:
            work()
        except ContactdError as error:
            assert str(error)  # noqa: PT017
