"""The protocol without sockets: handshake, frames both ways, rubbish."""

import can
import pytest
from can.interfaces.socketcand.socketcand import (
    convert_ascii_message_to_can_message,
    convert_can_message_to_ascii_message,
)
from hypothesis import given
from hypothesis import strategies as st

from simulator.socketcand import OK, REFUSED, Conversation, Reply, frame_line

frames = st.builds(
    lambda extended, number, data: can.Message(
        arbitration_id=number & (0x1FFFFFFF if extended else 0x7FF),
        is_extended_id=extended,
        data=data,
    ),
    st.booleans(),
    st.integers(0, 0x1FFFFFFF),
    st.binary(max_size=8),
)


def raw() -> Conversation:
    conversation = Conversation()
    assert conversation.feed(b"< open can0 >") == [Reply(OK)]
    assert conversation.feed(b"< rawmode >") == [Reply(OK, raw_mode=True)]
    return conversation


@given(frames)
def test_what_the_client_sends_is_understood(frame: can.Message) -> None:
    line = convert_can_message_to_ascii_message(frame).encode()
    (got,) = raw().feed(line)
    assert isinstance(got, can.Message)
    assert got.equals(frame, timestamp_delta=None, check_direction=False)


@given(frames)
def test_what_is_sent_is_understood_by_the_client(frame: can.Message) -> None:
    got = convert_ascii_message_to_can_message(frame_line(frame, 1.5).decode())
    assert got.equals(frame, timestamp_delta=None, check_direction=False)
    assert got.timestamp == 1.5


@given(st.lists(frames, max_size=5), st.lists(st.integers(1, 30), min_size=1))
def test_pieces_do_not_matter(sent: list[can.Message], cuts: list[int]) -> None:
    stream = b"".join(convert_can_message_to_ascii_message(f).encode() for f in sent)
    conversation, got, at = raw(), [], 0
    while at < len(stream):
        for cut in cuts:
            got += conversation.feed(stream[at : at + cut])
            at += cut
    assert [g.arbitration_id for g in got if isinstance(g, can.Message)] == [
        f.arbitration_id for f in sent
    ]


@given(st.binary(max_size=300))
def test_rubbish_is_refused_and_forgotten(rubbish: bytes) -> None:
    conversation = raw()
    conversation.feed(rubbish)
    conversation.feed(b" >" + b"x" * 300)
    answers = conversation.feed(b">< send 123 1 ff >")
    assert isinstance(answers[-1], can.Message)


@pytest.mark.parametrize("command", [b"< send 123 1 ff >", b"< rawmode >", b"< open >", b"hello>"])
def test_order_matters(command: bytes) -> None:
    assert Conversation().feed(command) == [Reply(REFUSED)]


@pytest.mark.parametrize(
    "words",
    [b"800 0", b"123 9 0 0 0 0 0 0 0 0 0", b"123 2 1", b"123 1 100", b"xyz 0", b"123", b"-1 0"],
)
def test_impossible_frames(words: bytes) -> None:
    assert raw().feed(b"< send " + words + b" >") == [Reply(REFUSED)]
