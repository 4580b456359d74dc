"""Drives that are set up again must be those of the start."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.rigs.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from bench.rigs.served_daemon import served_daemon
from common.errors import DriveError
from drivers.canopen.boot.boot_up import DriveBoot
from simulator.objects import key

SERIAL = key(0x1018, 4)


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig(SINGLE_JOINT) as rig, rig.lockstep.serving():
        yield rig


@pytest.fixture
def boot(rig: Rig) -> DriveBoot:
    """Set up, as at the start."""
    rig.boot.boot_up()
    return rig.boot


def test_a_drive_that_was_switched_off_and_on_is_the_same(rig: Rig, boot: DriveBoot) -> None:
    before = boot.identities
    rig.arm.drives[0].boot()
    assert rig.arm.drives[0].objects.number(0x6007) == 0
    called: list[None] = []
    boot.renew([0], lambda: called.append(None))
    assert rig.arm.drives[0].objects.number(0x6007) == 3
    assert boot.identities == before
    assert called


def test_another_drive_in_its_place_is_refused(rig: Rig, boot: DriveBoot) -> None:
    serial = boot.identities[0].serial
    rig.arm.drives[0].objects.values[SERIAL] = 4711
    with pytest.raises(DriveError, match=rf"^joint has another drive .*serial 4711; .*{serial}\."):
        boot.renew([0], lambda: None)
    rig.arm.drives[0].objects.values[SERIAL] = serial
    boot.renew([0], lambda: None)


def test_what_a_drive_said_before_it_was_set_up_again_is_over(tmp_path: Path) -> None:
    with served_daemon(tmp_path) as served:
        rig = served.rig
        (drive,) = rig.arm.drives
        drive.boot()
        served.run(0.05)
        drive._send_emergency(bytes([0x20, 0x32, 0x05, 0, 0, 0, 0, 0]))
        served.run(0.1)
        assert "emergency of node 1" in served.contactctl("status").output
        assert served.contactctl("reset").exit_code == 0
        served.run(0.5)
        assert served.contactctl("enable").exit_code == 0
        served.run(1.0)
        armed = served.contactctl("arm")
        assert armed.exit_code == 0, armed.output
