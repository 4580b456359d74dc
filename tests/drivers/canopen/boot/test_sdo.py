"""Objects by SDO: expedited, in segments, refused, garbled. Any answer raises a DriveError at
most."""

import struct
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import DriveError, SilentDriveError
from drivers.canopen.boot.sdo import LONGEST_ANSWER, ObjectAccess
from tests.drivers.canopen.boot.changed_setups import with_profile
from tests.examples import scaled

NODE = 3


class Network:
    """Part of canopen's network that an SDO client needs; `answer` takes a request's data."""

    def __init__(self, answer: Callable[[bytes], list[bytes]]) -> None:
        self.answer, self.hear = answer, None
        self.requests: list[bytes] = []

    def subscribe(self, cob_id, hear):
        assert cob_id == 0x580 + NODE
        self.hear = hear

    def send_message(self, cob_id, data):
        self.requests.append(bytes(data))
        for answer in self.answer(bytes(data)):
            self.hear(0x580 + NODE, bytearray(answer), 0.0)

    def check(self):
        pass  # nothing reads here that could fail


@pytest.fixture
def access(setups):
    return lambda answer: ObjectAccess(Network(answer), setups[NODE - 1], 0.001)


def upload(index: int, subindex: int, data: bytes) -> bytes:
    return struct.pack("<BHB", 0x43 | (4 - len(data)) << 2, index, subindex) + data.ljust(4, b"\0")


def segments(index: int, text: bytes) -> Callable[[bytes], list[bytes]]:
    parts = [text[k : k + 7] for k in range(0, len(text), 7)]

    def answer(request: bytes) -> list[bytes]:
        if request[0] & 0xE0 == 0x40:
            return [struct.pack("<BHBI", 0x41, index, 0, len(text))]
        part = parts.pop(0)
        head = request[0] & 0x10 | (7 - len(part)) << 1 | (not parts)
        return [bytes([head]) + part.ljust(7, b"\0")]

    return answer


def test_an_expedited_answer_is_read(access):
    assert access(lambda _: [upload(0x6041, 0, b"\x37\x02")]).read(0x6041) == 0x0237
    filled = access(lambda _: [upload(0x6041, 0, b"\x37\x02\xff\xff")])
    assert filled.read(0x6041) == 0x0237, "some drives fill an answer up"


@pytest.mark.parametrize("text", ["a", "exactly", "a longer name than one segment holds\0"])
def test_a_text_in_segments_is_read(access, text):
    assert access(segments(0x1008, text.encode())).read_text(0x1008) == text.strip("\0")


def test_a_number_in_segments_is_read(access):
    assert access(segments(0x6075, b"\xb0\x04\0\0")).read(0x6075) == 1200


def test_an_answer_without_end_is_refused(access):
    toggled = segments(0x1008, b"x" * 10_000)
    with pytest.raises(SilentDriveError, match="the answer does not end"):
        access(toggled).read_text(0x1008)
    assert LONGEST_ANSWER < 10_000


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (struct.pack("<BHBI", 0x80, 0x6041, 0, 0x06020000),
         r"reading was refused: Object does not exist \(0x06020000\)"),
        (struct.pack("<BHBI", 0x80, 0x6041, 0, 0x12345678), "reason unknown"),
        (upload(0x6041, 0, b"\x37"), r"malformed \(1 bytes, 2 expected\)"),
        (upload(0x6040, 0, b"\x37\x02"), "returned a value for 0x6040:00 instead"),
        (b"\x60" + bytes(7), "does not answer"),
        (b"\x43\x41", "malformed"),
        (b"\x80\x00", "malformed"),
        (b"", "malformed"),
    ],
)  # fmt: skip
def test_a_refused_or_garbled_answer_is_reported(access, answer, says):
    with pytest.raises(DriveError, match=r"node 3 \(LElbowRoll\).*" + says):
        access(lambda _: [answer]).read(0x6041)


def test_a_missing_answer_is_reported(access):
    with pytest.raises(
        SilentDriveError, match=r"does not answer \(SDO timeout 1 ms; object 0x6041"
    ):
        access(lambda _: []).read(0x6041)


def test_an_answer_that_waits_is_read_however_late(setups):
    access = ObjectAccess(Network(lambda _: [upload(0x6041, 0, b"\x37\x02")]), setups[2], 0.0)
    assert access.read(0x6041) == 0x0237


def test_no_transfer_begins_after_the_deadline(access):
    late = access(lambda _: [upload(0x6041, 0, b"\0\0")])
    late.deadline = 0.0
    with pytest.raises(SilentDriveError, match="out of time before object 0x6041:00: reading"):
        late.read(0x6041)


ANSWER = st.one_of(
    st.binary(max_size=8),
    # Right in its head, and anything behind it.
    st.builds(
        lambda command, where, tail: struct.pack("<BHB", command, *where) + tail,
        st.one_of(st.integers(0, 255), st.sampled_from([0x41, 0x43, 0x4B, 0x60, 0x80])),
        st.sampled_from([(0x6041, 0), (0x1016, 1), (0x1008, 0)]),
        st.binary(min_size=4, max_size=4),
    ),
    st.builds(lambda head, tail: bytes([head]) + tail, st.integers(0, 0x1F),
              st.binary(min_size=7, max_size=7)),
)  # fmt: skip


def refusal(work: Callable[[], object]) -> str:
    """Text of a DriveError; empty if there was none. Any other exception is one too many."""
    try:
        work()
    except DriveError as error:
        return str(error)
    return ""


@settings(max_examples=scaled(100))
@given(answers=st.lists(st.lists(ANSWER, max_size=2), max_size=12))
def test_any_answer_raises_a_drive_error_at_most(setups, answers):
    left = list(answers)
    access = ObjectAccess(Network(lambda _: left.pop(0) if left else []), setups[2], 0.0005)
    for work in (
        lambda: access.read(0x6041),
        lambda: access.read_text(0x1008),
        lambda: access.write(0x1016, 1, 127 << 16 | 100),
    ):
        said = refusal(work)
        assert "node 3 (LElbowRoll)" in said or not said


@settings(max_examples=scaled(8))
@given(
    harm=st.dictionaries(st.integers(0, 150), st.one_of(st.none(), ANSWER), min_size=1, max_size=4)
)
def test_a_garbled_boot_up_succeeds_or_names_the_drive(make_bench, setups, harm):
    bench = make_bench()
    drive = bench.simulated.drives[2]
    hasty = with_profile(setups[2], sdo_timeout_ms=30)
    send, count = drive._sdo.network._send, iter(range(1_000_000))

    def garbled(cob_id, data):
        number = next(count)
        if number not in harm:
            send(cob_id, data)
        elif harm[number] is not None:
            send(cob_id, harm[number])

    drive._sdo.network._send = garbled
    with bench.lockstep.serving():
        said = refusal(lambda: bench.boot([hasty]).boot_up())
    assert "node 3 (LElbowRoll)" in said or not said
    if not said:
        assert drive.objects.number(0x6007) == 3
        assert drive.objects.number(0x1800, 1) == 0x40000183
