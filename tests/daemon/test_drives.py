"""Drives that are set up again must be those of the start."""

from collections.abc import Iterator

import pytest

from bench.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from daemon.assembly import build_setups
from daemon.drives import Drives
from errors import DriveError
from simulator.objects import key

SERIAL = key(0x1018, 4)


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig(SINGLE_JOINT) as rig, rig.lockstep.serving():
        yield rig


@pytest.fixture
def drives(rig: Rig) -> Drives:
    """Set up, as at the start."""
    c = rig.robot.configuration
    drives = Drives(rig.bus, build_setups(rig.robot), c.period_ms, c.bus.master_node)
    drives.boot_up(lambda line: None)
    return drives


def test_a_drive_that_was_switched_off_and_on_is_the_same(rig: Rig, drives: Drives) -> None:
    before = list(drives.identities)
    rig.arm.drives[0].boot()
    assert rig.arm.drives[0].objects.number(0x6007) == 0
    called: list[None] = []
    drives.renew([0], lambda: called.append(None))
    assert rig.arm.drives[0].objects.number(0x6007) == 3
    assert drives.identities == before
    assert called


def test_another_drive_in_its_place_is_refused(rig: Rig, drives: Drives) -> None:
    serial = drives.identities[0].serial
    rig.arm.drives[0].objects.values[SERIAL] = 4711
    with pytest.raises(DriveError, match=rf"^joint has another drive .*serial 4711; .*{serial}\."):
        drives.renew([0], lambda: None)
    rig.arm.drives[0].objects.values[SERIAL] = serial
    drives.renew([0], lambda: None)
