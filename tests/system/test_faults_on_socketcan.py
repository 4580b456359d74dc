"""Faults that show in frames, on a CAN interface of the kernel."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.stand import run

ROOT = Path(__file__).resolve().parents[2]
# One for each make of drive, and one for a case that needs an arm of its own.
INTERFACES = [f"contactd-{number}" for number in range(4)]


def test_they_are_found_and_the_arm_stops(vcan: bool) -> None:
    """The same suite as on the other wires, in a process of its own, with `socketcan` as one."""
    if not vcan:
        pytest.skip("needs virtual CAN interfaces (vcan)")
    try:
        for name in INTERFACES:
            run("ip", "link", "add", name, "type", "vcan", check=True)
            run("ip", "link", "set", name, "up", check=True)
        suite = ["tests/daemon/faults/test_faults.py", "-k", "socketcan and not socketcand"]
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *suite]
        environment = os.environ | {"CONTACTD_VCAN": " ".join(INTERFACES)}
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )
    finally:
        for name in INTERFACES:
            run("ip", "link", "delete", name)
    assert done.returncode == 0, done.stdout[-6000:]
    assert " passed" in done.stdout
    print(done.stdout.splitlines()[-1])
