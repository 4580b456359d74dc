"""Error codes in words."""

import pytest

from drivers.canopen.emergency_codes import emergency_words


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
