"""The service `arm` as another program calls it: zenoh-ros2-sdk, and who calls it wrongly."""

import time
from collections.abc import Callable
from typing import Any

import pytest
import zenoh
from zenoh_ros2_sdk import discovery
from zenoh_ros2_sdk.utils import compute_service_type_hash

from programs.zenoh.arming import SET_BOOL
from programs.zenoh.holding import FIRST_CALL_S, ONCE
from programs.zenoh.names import attachment
from programs.zenoh.services import TRIGGER, endpoint
from programs.zenoh.type_hashes import TYPE_HASHES
from tests.programs.zenoh.bridge import Bridge, caller, until

ANSWER = "bool success\nstring message"
REQUESTS = {TRIGGER: "uint8 structure_needs_at_least_one_member", SET_BOOL: "bool data"}


@pytest.mark.parametrize("name", REQUESTS)
def test_the_hash_of_a_service_is_what_others_compute(name: str) -> None:
    """Digests of types; those of messages are compared in another test."""
    assert TYPE_HASHES[name] == compute_service_type_hash(name, REQUESTS[name], ANSWER)


def commands(daemon: Any) -> list[str]:
    known = ("arm", "renew", "disarm")
    return [command for command, _ in daemon.seen if command in known]


def test_another_arms_renews_and_disarms(fake_daemon: Any, sdk: int, start: Any) -> None:
    start(fake_daemon.path, sdk, arming=True).joined()
    where = (0, "127.0.0.1", sdk)
    offered = {"arm": SET_BOOL, "disarm": TRIGGER, "reset": TRIGGER, "stop": TRIGGER}
    expected = {f"/left_arm/{name}": [kind] for name, kind in offered.items()}
    until(lambda: dict(discovery.get_service_names_and_types(*where)) == expected)
    client = caller("/left_arm/arm", sdk, SET_BOOL, REQUESTS[SET_BOOL])
    done: list[str] = []

    def call(armed: bool) -> str:
        reply = client.call(data=armed)
        assert reply is not None
        if reply.success:
            done.append(reply.message)
        return str(reply.message)

    def armed_and_renewed() -> bool:
        """Calls on as a node does. Where the machine is busy, calls may come further apart than
        they were sent, or too late: then it lets go and begins again."""
        if call(True) == ONCE:
            time.sleep(FIRST_CALL_S + 0.05)
            return False
        return call(True) == "renew done" or not call(False)

    assert call(True) == ONCE
    until(armed_and_renewed)
    assert call(False) == "stands"
    client.close()
    assert done[-3:] == ["arm done", "renew done", "stands"]
    of = {"arm done": "arm", "renew done": "renew", "stands": "disarm"}
    assert commands(fake_daemon) == [of[said] for said in done]


TRUE = b"\0\1\0\0\1"
ABOUT = attachment(1, 1, b"a gid of 16 byte")
WRONG = [
    (TRUE, None, "its caller is unknown"),
    (TRUE, ABOUT[:-1], "its caller is unknown"),
    (TRUE, b"x" * 1_000_000, "its caller is unknown"),
    (b"\0\1\0\0\2", ABOUT, "no SetBool request"),
    (b"\0\1\0\0", ABOUT, "no SetBool request"),
    (b"\0\7\0\0\1", ABOUT, "no SetBool request"),
    (TRUE * 2, ABOUT, "no SetBool request"),
    (b"\1" * 1_000_000, ABOUT, "no SetBool request"),
    (None, ABOUT, "no SetBool request"),
]


@pytest.fixture
def key(fake_daemon: Any, routed: int, other: zenoh.Session, start: Callable[..., Bridge]) -> str:
    """Key of `arm`, which answers."""
    bridge = start(fake_daemon.path, routed, arming=True)
    found = bridge.node.key(endpoint(bridge.node, "arm", SET_BOOL))
    until(lambda: list(other.get(found, payload=b"none")))
    return found


@pytest.mark.parametrize(("payload", "about", "words"), WRONG)
def test_a_wrong_call_arms_nothing(
    fake_daemon: Any, other: zenoh.Session, key: str, payload: Any, about: Any, words: str
) -> None:
    (reply,) = other.get(key, payload=payload, attachment=about)
    said = reply.err.payload if reply.err is not None else reply.ok.payload
    assert words.encode() in said.to_bytes()
    assert commands(fake_daemon) == []


def test_a_thousand_calls_are_a_few_commands(
    fake_daemon: Any, other: zenoh.Session, key: str
) -> None:
    answered: list[bool] = []
    for number in range(1000):
        about = attachment(number, 1, bytes([1 + number % 7] * 16))
        other.get(
            key, lambda reply: answered.append(bool(reply.ok)), payload=TRUE, attachment=about
        )
    until(lambda: len(answered) == 1000)
    assert any(answered)
    assert commands(fake_daemon) == []  # all at once: their callers may be gone
