"""Rotors by drives that ramp, step or accelerate: none is given that is wrong."""

import pytest

from bench.rigs.reaching import Reaching
from bench.study.rotor_drives import Drives, rotors


@pytest.mark.parametrize("bandwidth_Hz", [5.0, 16.0])
def test_drives_that_ramp_give_their_rotors(bandwidth_Hz):
    found = rotors(Drives(reaching=Reaching(bandwidth_Hz=bandwidth_Hz)))
    assert found.given.sum() >= 6, found
    assert not found.wrong, found


@pytest.mark.parametrize(
    "drives",
    [
        Drives(reaching=Reaching(way="steps")),
        Drives(reaching=Reaching(way="steps", bandwidth_Hz=40.0)),
        Drives(reaching=Reaching(way="steps", bandwidth_Hz=30.0), filter_ms=1.0, taken_ms=2),
        Drives(reaching=Reaching(way="accelerates", acceleration=40.0), filter_ms=5.0),
    ],
)
def test_drives_that_do_not_keep_their_rotors(drives):
    found = rotors(drives)
    assert found.error.max() < -0.05, "B would be right: nothing to be refused"
    assert not found.given.any(), found
