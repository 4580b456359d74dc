"""Boot-up against the simulated drives."""

import pytest

from drivers.boot_up import boot_up


def test_every_drive_is_set_up_and_says_who_it_is(bench, setups):
    lines = []
    with bench.lockstep.serving():
        identities = boot_up(bench.bus, setups, period_ms=10, progress=lines.append, listen_s=0.01)
    assert [identity.serial for identity in identities] == list(range(1, 8))
    assert {identity.vendor for identity in identities} == {0x00C0DAC7}
    assert len(lines) == 2 * len(setups)
    print("\n".join(lines))
