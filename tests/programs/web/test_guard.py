"""Rules of who may ask the page's server: tables of requests, and a clock that is an argument."""

from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from programs.web.guard import (
    COMMAND_HEADER,
    MOST_ADDRESSES,
    WRONG_TOKENS,
    WRONG_TOKENS_S,
    OriginRules,
    Places,
    TokenCheck,
    command_refusal,
    hosts_of,
)

DOORSTEP = OriginRules(frozenset({"localhost:8420", "127.0.0.1:8420", "[::1]:8420"}))
TLS = OriginRules(frozenset({"arm.example"}), tls=True)
OWN = {"Host": "localhost:8420", "Origin": "http://localhost:8420"}


def status(
    headers: Mapping[str, str],
    method: str = "GET",
    *,
    upgrades: bool = False,
    origin_rules: OriginRules = DOORSTEP,
) -> int:
    refusal = origin_rules.refusal(method, headers, upgrades=upgrades)
    return refusal.status if refusal else 200


@pytest.mark.parametrize(
    ("headers", "method", "upgrades", "expected"),
    [
        ({"Host": "localhost:8420"}, "GET", False, 200),
        ({"Host": "LOCALHOST:8420"}, "GET", False, 200),
        ({"Host": "127.0.0.1:8420"}, "HEAD", False, 200),
        ({"Host": "[::1]:8420"}, "GET", False, 200),
        # A name that was made to point here, another port, nothing at all.
        ({"Host": "evil.example"}, "GET", False, 421),
        ({"Host": "localhost"}, "GET", False, 421),
        ({"Host": "localhost:8421"}, "GET", False, 421),
        ({"Host": "localhost:8420.evil.example"}, "GET", False, 421),
        ({}, "GET", False, 421),
        (OWN, "POST", False, 200),
        (OWN, "GET", True, 200),
        # Whatever changes something, and a WebSocket, must say where it comes from.
        ({"Host": "localhost:8420"}, "POST", False, 403),
        ({"Host": "localhost:8420"}, "GET", True, 403),
        ({**OWN, "Origin": "null"}, "POST", False, 403),
        ({**OWN, "Origin": "http://evil.example"}, "POST", False, 403),
        ({**OWN, "Origin": "http://evil.example"}, "GET", False, 403),
        ({**OWN, "Origin": "http://evil.example"}, "GET", True, 403),
        ({**OWN, "Origin": "https://localhost:8420"}, "POST", False, 403),
        ({**OWN, "Origin": "http://127.0.0.1:8420"}, "POST", False, 403),
        ({**OWN, "Sec-Fetch-Site": "cross-site"}, "POST", False, 403),
        ({**OWN, "Sec-Fetch-Site": "same-site"}, "GET", True, 403),
    ],
)
def test_hosts_and_origins(
    headers: dict[str, str], method: str, upgrades: bool, expected: int
) -> None:
    assert status(headers, method, upgrades=upgrades) == expected


def test_behind_tls_the_origin_is_https() -> None:
    headers = {"Host": "arm.example", "Origin": "https://arm.example"}
    assert status(headers, "POST", origin_rules=TLS) == 200
    assert status({**headers, "Origin": "http://arm.example"}, "POST", origin_rules=TLS) == 403


@given(st.text(max_size=40))
def test_no_other_host_and_origin_pass(text: str) -> None:
    if text.lower() not in DOORSTEP.hosts:
        assert status({"Host": text, "Origin": f"http://{text}"}, "POST") == 421
    assert status({**OWN, "Origin": text}, "POST") == (
        403 if text.lower() != OWN["Origin"] else 200
    )


@pytest.mark.parametrize("headers", [{}, {COMMAND_HEADER: "disarm"}, {COMMAND_HEADER: "STOP"}])
def test_a_command_needs_a_header_with_its_name(headers: dict[str, str]) -> None:
    refusal = command_refusal("stop", headers)
    assert refusal is not None
    assert refusal.status == 403
    assert command_refusal("stop", {COMMAND_HEADER: "stop"}) is None


def test_wrong_tokens_are_counted_by_address_and_forgotten() -> None:
    check = TokenCheck("0123456789abcdef")
    for i in range(WRONG_TOKENS):
        refusal = check.enter(f"guess {i}", "192.0.2.1", float(i))
        assert refusal is not None
        assert refusal.status == 401
    late = check.enter(check.token, "192.0.2.1", 10.0)
    assert late is not None
    assert late.status == 429
    assert check.enter(check.token, "192.0.2.2", 10.0) is None
    assert check.enter(check.token, "192.0.2.1", WRONG_TOKENS - 1 + WRONG_TOKENS_S) is None


def test_many_addresses_take_no_more_memory_and_no_more_guesses() -> None:
    check = TokenCheck("0123456789abcdef")
    statuses = [
        refusal.status
        for i in range(MOST_ADDRESSES + 10)
        if (refusal := check.enter("guess", f"address {i}", 0.0))
    ]
    assert statuses == [401] * MOST_ADDRESSES + [429] * 10


def test_the_cookie_proves_the_token_without_containing_it() -> None:
    check, other = TokenCheck("0123456789abcdef"), TokenCheck("0123456789abcdeg")
    assert check.admits(check.cookie)
    assert not check.admits("")
    assert not check.admits("é")
    assert not check.admits(check.token)
    assert not check.admits(other.cookie)
    assert check.token not in check.cookie
    assert TokenCheck("").admits("")


def test_places_are_bounded_in_all_and_by_address() -> None:
    places = Places(most=5, most_of_one=2)
    assert [places.take("a") for _ in range(3)] == [True, True, False]
    assert [places.take(name) for name in "bcde"] == [True, True, True, False]
    assert [places.may_have_more(name) for name in "abz"] == [False, True, True]
    places.leave("a")
    assert places.take("e")
    assert not places.take("a")


@pytest.mark.parametrize(
    ("names", "port", "expected"),
    [
        (["arm.local"], 8420, {"arm.local:8420"}),
        (["ARM.local"], 80, {"arm.local"}),
        (["arm.example"], None, {"arm.example"}),
        (["::1", "10.0.0.7"], 8420, {"[::1]:8420", "10.0.0.7:8420"}),
    ],
)
def test_hosts_of_names(names: list[str], port: int | None, expected: set[str]) -> None:
    assert hosts_of(names, port) == expected
