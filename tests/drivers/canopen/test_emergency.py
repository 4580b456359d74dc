"""Error codes in words."""

import pytest

from drivers.canopen.emergency_codes import emergency_words
from drivers.canopen.events import Emergency


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x0000, "no longer"),
        (0x1000, "generic error"),
        (0x2310, "over-current"),
        (0x2350, "current, output side"),
        (0x2001, "current"),
        (0x3120, "mains under-voltage"),
        (0x3220, "DC link under-voltage"),
        (0x3221, "DC link voltage"),
        (0x4210, "over-temperature of the drive"),
        (0x4310, "over-temperature of the motor"),
        (0x4380, "temperature of the motor"),
        (0x8130, "heartbeat of the master lost"),
        (0x81F0, "communication"),
        (0xFF01, "specific to the drive, see its manual"),
        (0xA000, ""),
    ],
)
def test_words(code: int, words: str) -> None:
    assert emergency_words(code) == words


def test_an_emergency_says_what_it_is() -> None:
    assert Emergency(3, 0x3220, 0x04).text == "0x3220 (DC link under-voltage), error register 0x04"
    assert Emergency(3, 0xA123, 0x01).text == "0xA123, error register 0x01"
