"""From the package to an identified arm, as docs/installing.md says, on a machine that had neither.

Each test is the next step. On a throw-away Debian 12, a quarter of an hour:

    python -m pytest -x tests/system/test_package.py --system --package A.deb --upgrade B.deb

B is newer. Then boot, and the same with test_package_rebooted.py. This Python must not be that of
/opt/contactd: `dpkg-deb -x A.deb /opt/tester` gives another. Where no user gets a real-time
priority (`ulimit -Hr`; a container), a drop-in does: AmbientCapabilities=CAP_SYS_NICE CAP_IPC_LOCK,
and the same in CapabilityBoundingSet=.
"""

from pathlib import Path

import pytest
import yaml

from tests.system.owner import (
    INSTALLED,
    MINE,
    NAME,
    Owner,
    content,
    move_in,
    pid,
    put_up_the_arm,
    reach_the_bus_by_tcp,
)
from tests.system.stand import run, wait_for

PAGE = "installing.md"
SHARED = (
    "man/man1/{}.1",
    "bash-completion/completions/{}",
    "zsh/vendor-completions/_{}",
    "fish/vendor_completions.d/{}.fish",
)


@pytest.fixture(scope="module")
def owner(package: Path) -> Owner:
    names = {"./contactd_0.1.0_amd64.deb": str(package), "my_arm": str(MINE), "NAME": NAME}
    return Owner(**names)


def test_it_is_installed_and_nothing_of_it_runs(owner: Owner, vcan: bool) -> None:
    move_in(vcan)
    said = owner.types(PAGE, "sudo apt install ./contactd_0.1.0_amd64.deb").stdout
    assert "Bring your arm's folder: sudo cp -rT my_arm /etc/contactd" in said
    units = ("contactd.service", "contactd-web.service", "contactd-zenoh.service")
    for unit in units:
        assert run("systemctl", "is-active", unit).stdout == "inactive\n"
        assert run("systemctl", "is-enabled", unit).stdout == "disabled\n"
    assert not INSTALLED.exists()
    for name in ("contactd", "contactctl", "contactd-web", "contactd-zenoh"):
        owner.shell(f"{name} --help >/dev/null")
        for page in SHARED:
            owner.shell(f"test -r /usr/share/{page.format(name)}")
    put_up_the_arm(vcan)


def test_the_owners_arm_is_brought_whatever_roots_umask_is(owner: Owner) -> None:
    owner.shell(f"sudo sh -c 'umask 077; cp -rT {MINE} {INSTALLED}'")
    owner.types(PAGE, "sudo chmod -R a+rX /etc/contactd")
    assert content(INSTALLED) == content(MINE)
    assert "good" in owner.types(PAGE, "contactd check /etc/contactd").stdout


def test_it_is_started_and_the_owner_may_command_it_and_read_its_log(
    owner: Owner, vcan: bool
) -> None:
    if not vcan:
        reach_the_bus_by_tcp()
    owner.types(PAGE, "sudo usermod -aG contact,systemd-journal NAME")
    assert "sudo systemctl start contactd" in owner.shell("contactctl status", fails=True).stderr
    owner.types(PAGE, "sudo systemctl enable --now contactd")
    wait_for(pid, "the service")
    owner.sees("off")
    assert "ready, off" in owner.shell("journalctl -u contactd --no-pager").stdout


@pytest.mark.parametrize("step", ["wiring", "gap", "friction", "thresholds"])
def test_it_is_identified(owner: Owner, step: str) -> None:
    command = f"sudo contactd identify {step}"
    owner.repeats(lambda: owner.tries(PAGE, command, yes=True), command, ready=owner.rests)
    assert owner.sees("off")["changed"] == []  # taken up
    found = yaml.safe_load((INSTALLED / "identified.yaml").read_text())["joints"]["joint"]
    assert found[step]


def test_it_may_be_armed(owner: Owner) -> None:
    owner.types("commissioning.md", "contactd identify")  # nothing is missing
    owner.holds()
    owner.arms()
    assert owner.status()["armed"]
    owner.rests()
