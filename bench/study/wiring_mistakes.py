"""Arms whose wiring is wrong, and what is said of it before anything else may be done."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from bench.report import Target
from bench.rigs.person import Person, Written, poor_guesses
from bench.study.commissioned import Show
from bench.study.upright_commissioning import at_upright_arm
from errors import DriveError


@dataclass(frozen=True, slots=True)
class Mistake:
    """One mistake of the wiring, and the joint at which `identify wiring` is asked."""

    name: str
    joint: str
    wire: Callable[[list[Written]], None]
    """changes the wiring of all joints"""
    hint: str
    """where to look, in the answer; "" where drives are refused before they are energised"""


def _turned(i: int, sign: str) -> Callable[[list[Written]], None]:
    """An encoder that counts the other way."""

    def wire(joints: list[Written]) -> None:
        joints[i]["wiring"][sign] = -1

    return wire


def _geared(i: int) -> Callable[[list[Written]], None]:
    """A gear ratio that is wrong by a tenth."""

    def wire(joints: list[Written]) -> None:
        joints[i]["wiring"]["gear"] *= 1.1

    return wire


def _swapped(i: int, j: int) -> Callable[[list[Written]], None]:
    """Swapped cables of two drives."""

    def wire(joints: list[Written]) -> None:
        first, second = joints[i]["wiring"], joints[j]["wiring"]
        first["node"], second["node"] = second["node"], first["node"]

    return wire


_SIGNS, _GEAR = "link_sign or motor_sign", "gear, or a scale"
_OTHER = "another joint than this one moved"
OF_ROMEO: Final = (
    Mistake("swapped sign", "LElbowRoll", _turned(2, "motor_sign"), _SIGNS),
    Mistake("gear wrong by 10 %", "LElbowYaw", _geared(3), _GEAR),
    Mistake("swapped pair of joints", "LShoulderPitch", _swapped(0, 1), ""),
    Mistake("swapped pair with drives alike", "LWristPitch", _swapped(5, 6), _OTHER),
)
OF_UPRIGHT: Final = (
    Mistake("motor_sign of the loaded shoulder", "shoulder", _turned(1, "motor_sign"), _SIGNS),
    Mistake("motor_sign of the loaded elbow", "elbow", _turned(2, "motor_sign"), _SIGNS),
    Mistake("link_sign of the wrist", "wrist_pitch", _turned(4, "link_sign"), _SIGNS),
    Mistake("gear of the shoulder wrong by 10 %", "shoulder", _geared(1), _GEAR),
)


def found(person: Person, mistake: Mistake) -> bool:
    """True where the mistake is refused, and the answer says where to look."""

    def change(written: Written) -> None:
        poor_guesses(written)
        mistake.wire(written["joints"])

    arm = person.another_arm(mistake.name, change=change)
    try:
        passed = person.identify(arm, "wiring", mistake.joint)
    except DriveError as error:
        person.show(f"$ contactd run\n{error}\n")
        return not mistake.hint
    said = " ".join(arm.output.split())
    return not passed and "nothing written" in said and mistake.hint in said


def mistakes(folder: Path, seed: int, show: Show) -> tuple[list[Target], dict[str, Any]]:
    """Both arms, wired wrongly in all ways; targets of the project, and which were found."""
    romeo = Person(folder / "romeo", seed, show)
    upright = at_upright_arm(folder / "upright", seed, show)
    told = {one.name: found(romeo, one) for one in OF_ROMEO}
    told |= {one.name: found(upright, one) for one in OF_UPRIGHT}
    name = f"mistakes of wiring found with their hint, of {len(told)}"
    return [Target(name, sum(told.values()), len(told), "", "higher")], {"found": told}
