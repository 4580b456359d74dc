"""Decoding of messages: no name from a client begins a line of the log or controls a terminal."""

import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.protocol.requests import Disarm, Header, Load, Request
from daemon.protocol.strict_json import StrictDecoder
from daemon.protocol.text import on_behalf_of, printable
from daemon.service.answers import SHORT_BYTES


def load(name: str) -> bytes:
    """A request to load a trajectory of this name, as any program could send it."""
    return json.dumps({"command": "load", "header": {"name": name, "joints": []}}).encode()


@pytest.mark.parametrize(
    "name",
    [
        "move.csv\n[fault tick=7] heartbeat lost: node 3",
        "move.csv\n",
        "\rmove.csv",
        "\x1b[2Jmove.csv",
        "move\x00.csv",
        "move\x7f.csv",
        "move\x9b31m.csv",
        "move\x85.csv",
        "move\u2028.csv",
        "move.csv\u2029",
        "move\u202ecsv.",
        "move\u2067.csv",
        "",
        65 * "m",
    ],
)
def test_a_name_that_is_not_one_line_is_refused(name: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=r"\$\.header\.name"):
        msgspec.json.decode(load(name), type=Request)


@pytest.mark.parametrize(
    ("packet", "ends"),
    [
        (b'{"command":"go","speed":5e-324}', "at `$.speed`, not 5e-324"),
        (b'{"command":"load","header":{"name":7,"joints":[]}}', "at `$.header.name`, not 7"),
        (b'{"command":"go","speed":9,"targets":{"\x95":1}}', ""),
        (b'{"command":"go","speed":9,"x":%s' % (900 * b"["), ""),
        (b'{"command":"go","targets":{"a":"x"}}', "`$.targets[...]`"),
    ],
)
def test_an_error_names_place_and_value(packet: bytes, ends: str) -> None:
    with pytest.raises(msgspec.DecodeError) as refused:
        StrictDecoder(Request).decode(packet)
    assert str(refused.value).endswith(ends)


@pytest.mark.parametrize("name", ["move.csv", "a swing, 2 (soft).csv", "Bewegung früh.csv", "動き"])
def test_other_names_are_taken_as_they_are(name: str) -> None:
    request = msgspec.json.decode(load(name), type=Request)
    assert request.header is not None
    assert request.header.name == name == printable(name)


@given(st.text(st.characters(), min_size=1, max_size=64))
def test_any_text_made_printable_is_a_valid_name(text: str) -> None:
    """Also lone surrogates, as which Python reads the names of files that are not UTF-8."""
    header = Header(name=printable(text), joints=[])
    packet = msgspec.json.encode(Load(header=header))
    assert msgspec.json.decode(packet, type=Request).header == header


@pytest.mark.parametrize("text", ["", 65 * "x", "a\nb", "a\x1b[2J", 'a"b', "a\\b", "Zoë", "動き"])
def test_on_behalf_of_takes_only_short_plain_text(text: str) -> None:
    packet = json.dumps({"command": "stop", "on_behalf_of": text}).encode()
    with pytest.raises(msgspec.ValidationError, match=r"\$\.on_behalf_of"):
        msgspec.json.decode(packet, type=Request)


@given(st.text(st.characters(), min_size=1))
def test_any_text_becomes_a_valid_on_behalf_of_in_a_short_packet(text: str) -> None:
    packet = msgspec.json.encode(Disarm(on_behalf_of=on_behalf_of(text)))
    assert msgspec.json.decode(packet, type=Request).on_behalf_of == on_behalf_of(text)
    assert len(packet) <= SHORT_BYTES
