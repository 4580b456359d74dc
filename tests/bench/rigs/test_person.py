"""The person of the benches does what the commands say, and nothing else."""

from pathlib import Path

import pytest

from bench.rigs.person import Person

GAIN = "the position loop is too fast for its gap. Set\ncontrol.position_gain to 2 (it is 8), start"
MASSES = "as the URDF's masses may be off: run `contactd\nidentify masses`, then `friction` again"


class ScriptedArm:
    """Arm that answers each step with what was written for it, once; then all is well."""

    def __init__(self, answers: dict[str, list[str]]) -> None:
        self.answers, self.did = answers, list[str]()
        self.output, self.lasted_s = "", 10.0

    def identify(self, step: str, *words: str, hand: str = "") -> bool:
        assert not hand
        self.did.append(" ".join([step, *words]))
        answers = self.answers.get(step, [])
        self.output = answers.pop(0) if answers else ""
        return "Set" not in self.output

    def set_position_gain(self, gain: float) -> None:
        self.did.append(f"gain {gain:g}")

    def arming_refusals(self) -> list[str]:
        return [] if "thresholds" in self.did else ["the wiring of joint was never checked"]


CASES = {
    "nothing to do": ({}, ["wiring", "gap", "friction", "thresholds"]),
    "a gain": (
        {"friction": [GAIN]},
        ["wiring", "gap", "friction", "gain 2", "friction", "thresholds"],
    ),
    "a daemon that fell silent": (
        {"gap": ["What was measured is kept: the same\ncommand goes on from there"]},
        ["wiring", "gap", "gap", "friction", "thresholds"],
    ),
    "masses": (
        {"friction": [MASSES]},
        ["wiring", "gap", "friction", "masses", "friction", "thresholds"],
    ),
    "masses, and more": (
        {"friction": [MASSES, "to +-10 %: `--seconds\n120` narrows that to +-7.5 %"]},
        ["wiring", "gap", "friction", "masses", "friction", "friction --seconds 120", "thresholds"],
    ),
    "a gain, then masses, and a gain with them": (
        {"friction": [GAIN, MASSES], "masses": [GAIN]},
        ["wiring", "gap", "friction", "gain 2", "friction",
         "masses", "gain 2", "masses", "friction", "thresholds"],
    ),
    "gains without end": (
        {"thresholds": [GAIN] * 9},
        ["wiring", "gap", "friction", *["thresholds", "gain 2"] * 4],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("answers", "did"), CASES.values(), ids=CASES)
def test_the_person_does_what_is_told(
    tmp_path: Path, answers: dict[str, list[str]], did: list[str]
) -> None:
    person = Person(tmp_path, 1, lambda text: None)
    arm = ScriptedArm({step: list(texts) for step, texts in answers.items()})
    person.arm = arm  # type: ignore[assignment]
    went = person.from_zero_to_armed()
    assert arm.did == did
    assert went["armed after"]
    assert went["thresholds"] is (did[-1] == "thresholds")
    assert person.took["wiring"] == 10.0
    assert sum(person.took.values()) == 10.0 * sum(not one.startswith("gain") for one in did)
