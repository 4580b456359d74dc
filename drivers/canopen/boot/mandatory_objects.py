"""Objects without which a drive is refused, and the consequences of their absence."""

from collections.abc import Mapping
from typing import Final

_NOT_IDENTIFIED: Final = "it cannot be identified"
FOLLOWS: Final[Mapping[tuple[int, int], str]] = {
    (0x1000, 0): _NOT_IDENTIFIED,
    (0x1018, 1): _NOT_IDENTIFIED,
    (0x1016, 1): "it cannot monitor the master's heartbeat, and would keep moving without a master",
    (0x1017, 0): "it sends no heartbeat",
    (0x6007, 0): "it cannot be configured to stop when the master falls silent",
    (0x605A, 0): "it cannot be configured to hold after a quick stop",
    (0x6060, 0): "its mode cannot be selected",
}
#: Read at boot-up: a drive cannot be identified without them.
MUST_BE_READ: Final = ((0x1000, 0), (0x1018, 1))
