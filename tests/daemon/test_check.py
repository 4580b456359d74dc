"""`contactd check`: quantities, PDOs and the load of the bus that follow from a configuration."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from bench.lockstep import DESK_ARM
from daemon.commands.contactd import main


def check(folder: Path):
    return CliRunner().invoke(main, ["check", str(folder)], catch_exceptions=False)


def test_the_table_of_quantities():
    lines = [line.split() for line in check(DESK_ARM).output.splitlines()]
    for row in (
        "torque 0x6077 0 INTEGER16 0.001 -1 0 of the rated torque",
        "link_position 0x6064 0 INTEGER32 2.39684e-05 -1 -1.24636 rad at the link",
        "motor_velocity 0x6069 0 INTEGER16 0.10472 +1 0 rad/s of the motor",
        "motor_position - not sent: integrated from the velocity",
        "max_motor_speed 0x607F 0 UNSIGNED32 0.00628319 +1 0 rad/s of the motor",
        "TPDO1 0x180 + node 4 statusword 0x6041:00/16, torque 0x6077:00/16",
        "RPDO2 0x300 + node 4 target_velocity 0x60FF:00/32",
        "without object 0x6073:00 (current limit, per mille of rated): it has no current limit of "
        "its own",
        "0x28C 6 100 115 swing TPDO2",
    ):
        assert row.split() in lines, row


def test_the_load_of_the_bus():
    last = check(DESK_ARM).output.splitlines()[-2]
    # SYNC 55 bits; per drive TPDOs of 95 and 115, RPDOs of 75 and 95; heartbeats of 65, 25 a
    # second from each drive and from the master, all on half a megabit.
    exchange = 55 + 2 * (95 + 115 + 75 + 95)
    load = (100 * exchange + 3 * 25 * 65) / 500_000
    assert last == (
        f"bus load at worst {load:.1%} of 500000 bit/s (allowed 80%); "
        f"one exchange takes {exchange / 500:.2f} of 10 ms"
    )


@pytest.mark.parametrize("bitrate", [100_000, 10_000])
def test_what_does_not_fit_the_bitrate_is_refused(tmp_path, bitrate):
    for path in DESK_ARM.iterdir():
        text = path.read_text()
        (tmp_path / path.name).write_text(text.replace("bitrate: 500000", f"bitrate: {bitrate}"))
    result = check(tmp_path)
    assert result.exit_code == 78
    assert f"bus.bitrate: bus load {1.7275 * 50_000 / bitrate:.0%} at {bitrate} bit/s" in (
        result.output
    )
