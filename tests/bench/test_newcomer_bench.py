"""The scripted owner's first steps, and what the planted mistakes come to at an arm."""

from pathlib import Path

import pytest

from bench.newcomer import targets_of
from bench.rigs.generated_arms import generate
from bench.rigs.owner import SEEN, Owner, Story
from bench.study.mistakes import MISTAKES
from bench.study.unrefused import Met, met
from daemon.config.load import load_robot

OF_WORDS = {mistake.words: mistake for mistake in MISTAKES}


def test_an_owner_finds_signs_and_zeros_of_the_links_by_pushing_them(tmp_path: Path) -> None:
    arm = generate(0)
    owner = Owner(arm, tmp_path)
    owner.begin()
    with owner.running() as served:
        owner.zeros(served)
    found = load_robot(owner.folder).configuration.joints
    assert any(joint["wiring"]["link_sign"] < 0 for joint in arm.joints)
    for joint, true in zip(found, arm.joints, strict=True):
        wiring = true["wiring"]
        assert joint.wiring.link_sign == wiring["link_sign"]
        assert joint.wiring.link_offset == pytest.approx(wiring["link_offset"], abs=SEEN)
        assert joint.wiring.gear == wiring["gear"]
        assert joint.torque_constant == true["torque_constant"]
    assert not owner.story.seen
    assert owner.story.commands == [
        "contactd new", "contactd check", "contactd run", "contactd identify zero",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "reported", "says"),
    [
        ("the motor's sign", False, "shoulder: the link moves opposite to the motor"),
        ("a gear of 80 in place of 100", False, "gear, or a scale"),
        ("rated and largest current swapped", True, ""),
        ("an encoder in degrees per count", True, ""),
    ],
)
def test_a_mistake_that_is_not_refused_arms_nothing(words, reported, says, tmp_path: Path) -> None:
    # The gear of this arm's shoulder is 160.
    found = met(OF_WORDS[words], generate(2), tmp_path / "arm")
    assert found.reported is reported
    assert not found.refused
    assert not found.harmful
    assert says in " ".join(found.ended.split())


@pytest.mark.parametrize(
    ("met", "harmful"),
    [
        (Met("reported, and the wiring is good", reported=True, wiring_good=True), False),
        (Met("found by the wiring", reported=False, ended="wrong"), False),
        (Met("found by nothing", reported=False, wiring_good=True), True),
        (Met("armed", reported=True, armed=True), True),
        (Met("ran", reported=True, ran=True), True),
    ],
)
def test_what_counts_as_harm(met: Met, harmful: bool) -> None:
    assert met.harmful is harmful


def test_targets_count_who_got_there() -> None:
    def story(seed: int, *, led: bool) -> Story:
        commands = ["contactd run", "contactd run", "contactctl arm"] * (1 + seed)
        inside = {"K_theta_s": [True, True, True, False], "B": [True]}
        seen = ["base.link_sign"]
        return Story(seed, "alder", 4, False, commands, seen, led, led, "", 60.0, inside)

    by_name = {t.name: t.value for t in targets_of([story(0, led=True), story(9, led=False)])}
    assert by_name["owners who armed and led their arm, of 2"] == 1
    assert by_name["different commands of an owner who got there, at most"] == 2
    assert by_name["Coulomb friction answered, of 4 joints"] == 100.0
    assert by_name["Coulomb friction within the interval"] == 75.0
    assert by_name["rotors answered, of 4 joints"] == 25.0
    assert by_name["rotors within the interval"] == 100.0
    assert by_name["gaps answered, of 4 joints"] == 0.0
    assert by_name["commands typed, every start of the daemon among them, at most"] == 3
