"""Faults that show in frames, on a CAN interface of the kernel."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.stand import run

ROOT = Path(__file__).resolve().parents[2]
INTERFACE = "contactd-faults"


def test_they_are_found_and_the_arm_stops(vcan: bool) -> None:
    """The same suite as on the other wires, in a process of its own, with `socketcan` as one."""
    if not vcan:
        pytest.skip("needs virtual CAN interfaces (vcan)")
    run("ip", "link", "add", INTERFACE, "type", "vcan", check=True)
    try:
        run("ip", "link", "set", INTERFACE, "up", check=True)
        suite = ["tests/daemon/faults/test_faults.py", "-k", "socketcan and not socketcand"]
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *suite]
        environment = os.environ | {"CONTACTD_VCAN": INTERFACE}
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )
    finally:
        run("ip", "link", "delete", INTERFACE)
    assert done.returncode == 0, done.stdout[-4000:]
    assert " passed" in done.stdout
    print(done.stdout.splitlines()[-1])
