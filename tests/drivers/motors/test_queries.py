"""Questions to motors, and answers that a busy machine reads late."""

from dataclasses import dataclass, field

import pytest

from drivers.can.wire import Frame
from drivers.motors.queries import Queries, received_frames

TIMEOUT_S = 0.05
ANSWER = (0x11, b"answer")


@dataclass
class HeldUp:
    """Wire on which an answer is there at once, and a process that is held up as soon as it has
    asked; `others` are frames before the answer."""

    held_up_s: float
    others: int = 0
    now_s: float = 0.0
    queued: list[Frame] = field(default_factory=list)

    def send(self, frames: list[Frame]) -> None:
        self.queued = [(0x12, b"other")] * self.others + [ANSWER]

    def receive(self, timeout: float) -> Frame | None:
        if self.queued:
            self.now_s += self.held_up_s
            return self.queued.pop(0)
        self.now_s += timeout
        return None


@pytest.mark.parametrize("others", [0, 3])
@pytest.mark.parametrize("held_up_s", [0.0, 0.02, 0.2, 2.0])
def test_what_came_meanwhile_is_an_answer(held_up_s: float, others: int) -> None:
    wire = HeldUp(held_up_s, others)

    def held_up() -> float:
        wire.now_s += held_up_s
        return wire.now_s

    asking = Queries(wire, clock=held_up)
    answer = asking.ask((1, b""), lambda can_id, _: can_id == ANSWER[0] or None, TIMEOUT_S)
    assert answer is True
    wire.send([])
    assert list(received_frames(wire, TIMEOUT_S, clock=held_up))[-1] == ANSWER


def test_silence_ends_after_three_times_the_patience() -> None:
    wire = HeldUp(0.0)
    asking = Queries(wire, clock=lambda: wire.now_s)
    assert asking.ask((1, b""), lambda *_: None, TIMEOUT_S) is None
    assert wire.now_s == pytest.approx(3 * TIMEOUT_S, abs=0.02)


def test_a_flood_does_not_hold_it_for_ever() -> None:
    class Flood(HeldUp):
        def receive(self, timeout: float) -> Frame | None:
            self.now_s += 1e-4
            return 0x12, b"other"

    wire = Flood(0.0)
    assert Queries(wire, clock=lambda: wire.now_s).ask((1, b""), lambda *_: None, TIMEOUT_S) is None
    assert wire.now_s < 2.0
