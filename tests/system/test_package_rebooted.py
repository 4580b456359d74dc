"""After a boot the installed arm is there by itself, on the machine that test_package.py left."""

from pathlib import Path

import pytest

from tests.system.owner import INSTALLED, Owner, since_power_on_s


def test_from_power_on_it_is_off_and_ready_to_enable_by_itself(package: Path) -> None:
    if not (INSTALLED / "identified.yaml").exists():
        pytest.skip("needs the machine that test_package.py left, booted again")
    assert not Owner().sees("off")["armed"]
    print(f"\noff, ready to enable {since_power_on_s():.1f} s after power-on")
