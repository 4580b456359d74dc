"""Drives that are set up again must be those of the start."""

from dataclasses import replace
from unittest.mock import Mock

import pytest

from daemon import drives
from drivers.boot_up import DriveIdentity
from errors import DriveError

SAME = DriveIdentity("elbow", 3, 0x1, 0x402, 0x10000, 7)


@pytest.mark.parametrize(
    ("answer", "refused"), [(SAME, False), (replace(SAME, serial=8), True)], ids=["same", "other"]
)
def test_another_drive_than_at_the_start_is_refused(
    monkeypatch: pytest.MonkeyPatch, answer: DriveIdentity, refused: bool
) -> None:
    setup = Mock()
    setup.name = "elbow"
    arm = drives.Drives(Mock(), [setup], 10, 127, [SAME])
    monkeypatch.setattr(drives, "boot_up_again", lambda *_, **__: [answer])
    if refused:
        with pytest.raises(DriveError, match=r"elbow has another drive .*serial 8.*serial 7"):
            arm.renew([0])
    else:
        arm.renew([0])
    assert arm.identities == [SAME]
