"""After a boot: the installed arm is there by itself, is used, updated and taken out, by the docs.

On the machine that test_package.py left, with `--package` and a newer `--upgrade`, each test the
next step.
"""

import csv
import time
from pathlib import Path
from typing import Any

import pytest

from tests.system.owner import HAND, HOME, INSTALLED, Owner, content, pid, since_power_on_s
from tests.system.stand import POLL_S, run, wait_for

PAGE, PLAYBACK = "installing.md", "playback.md"
INSTALL = "sudo apt install ./contactd_0.1.0_amd64.deb"
DROP_INS = Path("/etc/systemd/system/contactd.service.d")
MOVE, PLAYED = HOME / "move.csv", HOME / "played.csv"
FIRST = "LElbowRoll=-0.803 LElbowYaw=-0.300"  # as the page's recording begins
AT_HOME = 0.2
MOST_LOOKS = 50  # at a hand that leads, which takes some three seconds
LED = 0.3  # rad, at least, of the way from 0.2 to 0.8 that the hand wants
NEAR = 0.05  # rad: half a gap, and the mean of a sample


@pytest.fixture(scope="module")
def owner(upgrade: Path) -> Owner:
    if not (INSTALLED / "identified.yaml").exists():
        pytest.skip("needs the machine that test_package.py left, booted again")
    return Owner(**{"./contactd_0.1.0_amd64.deb": str(upgrade)})


@pytest.fixture(scope="module")
def brought(owner: Owner) -> dict[str, bytes]:
    """The folder as its owner left it, identified, and what else is the owner's own."""
    return kept()


def kept() -> dict[str, bytes]:
    return content(INSTALLED) | content(DROP_INS)


def positions(file: Path) -> list[float]:
    """Column of the joint in a trajectory [rad]."""
    with file.open(newline="") as stream:
        return [float(row["joint"]) for row in csv.DictReader(stream)]


def test_from_power_on_it_is_off_and_ready_to_enable_by_itself(
    owner: Owner, brought: dict[str, bytes]
) -> None:
    assert not owner.sees("off")["armed"]
    print(f"\noff, ready to enable {since_power_on_s():.1f} s after power-on")


def test_it_is_armed_and_goes_home(owner: Owner) -> None:
    def goes() -> bool:
        owner.arms()
        return owner.tries(PLAYBACK, "contactctl home", yes=True)

    owner.repeats(goes, "home")
    assert "the way to home came to its end" in owner.status()["cause"]


def test_it_is_led_and_that_is_recorded(owner: Owner) -> None:
    hand = f"contactctl hand --hand-socket {HAND}"

    def leads() -> bool:
        owner.arms()
        if not owner.tries(PLAYBACK, "contactctl home", yes=True):
            return False
        recorded = owner.begins(f"contactctl record {MOVE} --seconds 16", MOVE)
        owner.shell(f"{hand} lead joint --speed 0.3 0.8rad")
        led = any(yielded(owner.status()) for _ in range(MOST_LOOKS))
        owner.shell(f"{hand} release")
        wait_for(recorded, "the recording's end")
        return led and positions(MOVE)[-1] - positions(MOVE)[0] > LED

    owner.repeats(leads, "leading")
    assert "quiet for" in owner.status()["cause"]


def yielded(status: dict[str, Any]) -> bool:
    """Whether the arm yields, and went along; where not, after a moment."""
    if status.get("mode") == "admittance" and status["link_position"][0] > AT_HOME + LED + NEAR:
        return True
    time.sleep(POLL_S)
    return False


def test_what_was_recorded_is_played_back(owner: Owner) -> None:
    led = positions(MOVE)
    owner.names |= {FIRST: f"joint={led[0]}", "move.csv": str(MOVE)}

    def plays() -> bool:
        owner.arms()
        if not owner.tries(PLAYBACK, f"contactctl go {FIRST}", yes=True):
            return False
        recorded = owner.begins(f"contactctl record {PLAYED} --seconds 40", PLAYED)
        started = owner.tries(PLAYBACK, "contactctl start move.csv --speed 0.5")
        wait_for(recorded, "the recording's end")
        ended = owner.sees("holding", "off", "faulted")["cause"]
        return started and "move.csv came to its end" in ended

    owner.repeats(plays, "playing it back")
    (at,) = owner.status()["link_position"]
    assert at == pytest.approx(led[-1], abs=NEAR)
    played = positions(PLAYED)
    assert (min(played), max(played)) == pytest.approx((min(led), max(led)), abs=NEAR)


def test_an_arm_that_has_power_is_not_updated_and_one_that_is_off_is(
    owner: Owner, brought: dict[str, bytes]
) -> None:
    owner.holds()
    before, version = pid(), owner.shell("contactd --version").stdout
    refused = owner.types(PAGE, INSTALL, fails=True)
    assert "the arm is not off (mode: holding)" in refused.stdout + refused.stderr
    assert (pid(), owner.shell("contactd --version").stdout) == (before, version)
    assert owner.status()["mode"] == "holding"
    assert run("dpkg", "--audit").stdout == ""
    owner.rests()
    owner.types(PAGE, INSTALL)
    wait_for(lambda: pid() not in (0, before), "the next daemon, by itself")
    owner.sees("off")
    assert kept() == brought
    assert run("systemctl", "is-enabled", "contactd").stdout == "enabled\n"
    owner.holds()
    owner.arms()  # as identified


def test_it_is_not_removed_from_under_an_arm_that_has_power(owner: Owner) -> None:
    owner.holds()
    refused = owner.types(PAGE, "sudo apt remove contactd", fails=True)
    assert "the arm is not off (mode: holding)" in refused.stdout + refused.stderr
    assert owner.status()["mode"] == "holding"
    owner.rests()


def test_removed_it_leaves_the_arms_folder_and_its_records(
    owner: Owner, brought: dict[str, bytes]
) -> None:
    owner.types(PAGE, "sudo apt remove contactd")
    assert run("systemctl", "cat", "contactd.service").returncode != 0
    assert not Path("/opt/contactd").exists()
    assert not list(Path("/usr").glob("bin/contact*"))
    assert kept() == brought
    assert Path("/var/lib/contactd").is_dir()


def test_purged_it_leaves_what_it_says(owner: Owner, brought: dict[str, bytes]) -> None:
    said = owner.types(PAGE, "sudo apt purge contactd").stdout
    assert kept() == brought
    for path in ("/var/lib/contactd", "/var/lib/contactd-web"):
        assert path in said
        assert not Path(path).exists()
    assert "Kept: /etc/contactd" in said
    assert not Path("/opt/contactd").exists()
    left = run("find", "/etc", "/usr", "/var", "/run", "-xdev", "-name", "contactd*").stdout
    assert set(left.split()) == {str(INSTALLED), str(DROP_INS)}
