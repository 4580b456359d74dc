"""`contactd new --drive`: a draft for Damiao motors, by their models alone."""

import re
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from bench.rigs.lockstep import DESK_ARM, OPENARM, ROMEO
from bench.study.mistakes import reported
from drivers.damiao.settings import MODELS, Model
from programs.contactd.drafts.motor import Load
from programs.contactd.drafts.motors import MOST_SAG, gains
from tests.golden_words import same_words
from tests.programs.contactd.drafting import GOLDEN, config_of, contactd, each, rehearsal

OF_JOINTS = ("DM8009", "DM8009", "DM4340", "DM4340", "DM4310", "DM4310", "DM4310")


def new(folder: Path, urdf: Path, *words: str) -> Result:
    return contactd("new", folder, "--urdf", urdf, *words)


def drives(*given: str) -> list[str]:
    return each("--drive", *given)


@pytest.fixture
def openarm(tmp_path: Path) -> Path:
    """Draft of OpenArm's left arm by its models; the last holds for the remaining joints."""
    models = [f"damiao:{model}" for model in OF_JOINTS[:5]]
    result = new(tmp_path / "mine", OPENARM / "arm.urdf", *drives(*models))
    assert result.exit_code == 0, result.output
    assert "too weak" not in result.output
    return tmp_path / "mine"


def test_the_draft_has_the_makers_figures_and_passes_the_check(openarm: Path) -> None:
    said = reported(openarm)
    assert (said.refused, said.lines) == (False, [])
    written = config_of(openarm)
    assert {name: profile["model"] for name, profile in written["drives"].items()} == {
        model: model for model in OF_JOINTS
    }
    for i, (joint, model) in enumerate(zip(written["joints"], OF_JOINTS, strict=True)):
        wiring, known = joint["wiring"], MODELS[model]
        assert (wiring["node"], wiring["profile"], wiring["gear"]) == (i + 1, model, known.gear)
        assert joint["torque_constant"] == known.torque_constant
        assert wiring["rated_current_A"] * joint["torque_constant"] == pytest.approx(
            known.rated_Nm, rel=1e-3
        )
        assert wiring["max_current_A"] == known.max_current_A
        assert joint["rotor_inertia"] == pytest.approx(known.rotor * known.gear**2, rel=1e-3)
        assert joint["end"] == "hold"


def test_words_of_the_draft(openarm: Path) -> None:
    """Guesses are marked CHECK, published figures are not."""
    same_words(GOLDEN / "new_openarm.txt", (openarm / "config.yaml").read_text())


def test_the_draft_can_be_rehearsed_at_once(openarm: Path) -> None:
    with rehearsal(openarm) as rig:
        begun = rig.arm.plant.q.copy()
        rig.run(1.0)
        assert rig.tick.controller.machine.mode == "holding"
        assert np.abs(rig.arm.plant.q - begun).max() < MOST_SAG
        for torque in (5.0, 0.0, -5.0, 0.0):  # a softer motor swings, and is none that obeys
            rig.arm.external_torque[0] = torque
            rig.run(1.5)
            assert rig.tick.controller.machine.mode == "holding", torque


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("gravity", [0.1, 1.0, 5.0, 20.0])
@pytest.mark.parametrize("inertia", [0.001, 0.05, 0.4, 2.0])
def test_gains_damp_the_heaviest_joint_as_far_as_frames_go(
    model: Model, gravity: float, inertia: float
) -> None:
    rotor = MODELS[model].rotor * MODELS[model].gear ** 2
    k, d = gains([Load(gravity, inertia), Load(gravity / 2.0, inertia / 2.0)], MODELS[model])
    ratio = d / (2.0 * sqrt(k * (rotor + inertia)))
    assert 0.0 < k <= 500.0
    assert 0.0 < d <= 5.0
    assert gravity / k <= MOST_SAG * 1.001
    softest = gravity / k > MOST_SAG * 0.999
    assert ratio > 0.7 or (softest and d == 5.0)
    if ratio > 0.7 and d < 4.99:
        assert sqrt(k / (rotor + inertia)) > 14.9


def test_each_model_alone_is_a_draft(tmp_path: Path) -> None:
    for model in MODELS:
        result = new(tmp_path / model, DESK_ARM / "arm.urdf", *drives(f"damiao:{model.lower()}"))
        assert result.exit_code == 0, result.output
        assert reported(tmp_path / model).lines == []


def test_a_motor_too_weak_for_its_joint_is_named(tmp_path: Path) -> None:
    weak = drives("big=damiao:DM8009", "small=damiao:DM4310")
    result = new(tmp_path / "mine", OPENARM / "arm.urdf", *weak)
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "big (at joint1, CHECK): can be used" in said
    assert f"contactd guard {tmp_path / 'mine'} holds the arm" in said
    assert re.search(r"small \(at joint2, .*CHECK\): is too weak: .* it is rated for 3 Nm", said)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "either --eds"),
        (["--eds", str(ROMEO / "drive.eds"), *drives("damiao:DM4340")], "must be of one make"),
        ([*drives("damiao:DM4340"), "--object", "current=0x6078"], "--object"),
        (drives("damiao:DM4341"), "there are damiao:DM4310, damiao:DM4340"),
        (drives("robstride:RS09"), "robstride has no model RS09; there are robstride:RS00, "),
        (drives("damio:DM4340"), "--drive damio:DM4340: no make damio; there are damiao:DM4310, "),
        (drives("damiao:"), "--drive damiao:: must be [NAME=]MAKE:MODEL; there are damiao:DM4310"),
        (drives("DM4340"), "must be [NAME=]MAKE:MODEL; there are damiao:DM4310"),
        (drives("a=damiao:DM4340", "a=damiao:DM4310"), "a names another model already"),
        (drives(*8 * ["damiao:DM4340"]), "has only 7 joints"),
    ],
)  # fmt: skip
def test_a_wrong_choice_of_drives_is_refused(words: list[str], says: str, tmp_path: Path) -> None:
    result = new(tmp_path / "mine", OPENARM / "arm.urdf", *words)
    assert result.exit_code == 78, result.output
    assert says in " ".join(result.output.split())
    assert not (tmp_path / "mine").exists()
