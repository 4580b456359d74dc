"""The bus load at worst."""

from dataclasses import replace

import pytest

from common.errors import ConfigurationError
from drivers.can.load import bus_load, frame_bits, refuse_overload
from drivers.canopen.make import frames
from drivers.drive import Drive
from drivers.stopping.travel import least_master_timeout_s, worst_travel


def stuffed(bits: str) -> int:
    """Length after bit stuffing as a controller does it: a complement after five equal bits."""
    out: list[str] = []
    for bit in bits:
        out.append(bit)
        if len(out) >= 5 and len(set(out[-5:])) == 1:
            out.append("1" if bit == "0" else "0")
    return len(out)


@pytest.mark.parametrize("extended", [False, True])
@pytest.mark.parametrize("size", range(9))
def test_no_frame_is_longer_than_the_worst_and_one_is_as_long(size, extended):
    stuffable = (54 if extended else 34) + 8 * size
    # Five zeros, then four ones and four zeros in turn: each run is completed by a stuff bit.
    worst = ("00000" + "11110000" * 20)[:stuffable]
    longest = frame_bits(size, extended=extended)
    assert longest == stuffed(worst) + 13
    for pattern in ("0" * stuffable, "1" * stuffable, ("01" * 60)[:stuffable]):
        assert stuffed(pattern) + 13 <= longest


def test_romeo_takes_about_a_quarter_of_a_megabit(joint_drives):
    table = frames(joint_drives, 0.010)
    assert sum(frame.name.split()[-1].startswith("TPDO") for frame in table) == 14
    assert sum(frame.name.split()[-1].startswith("RPDO") for frame in table) == 7
    per_tick = 55 + 7 * (135 + 135 + 115)
    # The master beats every 30 ms, each drive every 50 ms, 65 bits each.
    wanted = 100 * per_tick + 65 / 0.030 + 7 * 65 / 0.050
    assert bus_load(frames(joint_drives, 0.010), 1_000_000) == pytest.approx(wanted / 1e6)
    refuse_overload(frames(joint_drives, 0.010), 0.010, 1_000_000)


def test_what_does_not_fit_is_refused(joint_drives):
    with pytest.raises(ConfigurationError, match=r"bus load 115% at 250000 bit/s and 10 ms"):
        refuse_overload(frames(joint_drives, 0.010), 0.010, 250_000)
    refuse_overload(frames(joint_drives, 0.010), 0.010, 500_000)


@pytest.mark.parametrize(
    ("velocity", "braking"),
    [(1.0, 0.05), (2.0, 0.2)],  # 1 / (2 * 10), 4 / (2 * 10)
)
def test_the_travel_of_a_joint(joint_drives: list[Drive], velocity: float, braking: float) -> None:
    drives = [replace(drive, velocity=velocity, quick_stop=10.0) for drive in joint_drives]
    travel = worst_travel(drives, 0.01, detection_s=0.03)[0]
    assert travel.detection == pytest.approx(0.03 * velocity)  # three ticks of 10 ms
    assert travel.stages == pytest.approx(0.09 * velocity)  # three ticks each
    assert travel.master_timeout == 0.1 * velocity  # 100 ms
    assert travel.braking == braking
    assert travel.total == pytest.approx(0.22 * velocity + braking)
    assert least_master_timeout_s(drives) == 0.1
