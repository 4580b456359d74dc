"""`contactd check`: quantities, PDOs and the load of the bus that follow from a configuration."""

import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT
from daemon.commands.check import print_check
from daemon.commands.contactd import main


def check(folder: Path):
    return CliRunner().invoke(main, ["check", str(folder)], catch_exceptions=False)


def test_the_table_of_quantities():
    lines = [line.split() for line in check(DESK_ARM).output.splitlines()]
    for row in (
        "torque 0x6077:00 INTEGER16 0.001 -1 0 of rated",
        "link_position 0x6064:00 INTEGER32 2.39684e-05 -1 -1.24636 rad",
        "motor_velocity 0x6069:00 INTEGER16 0.10472 +1 0 rad/s",
        "without motor_position: integrated from the velocity",
        "max_motor_speed 0x607F:00 UNSIGNED32 0.00628319 +1 0 rad/s",
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


@pytest.mark.parametrize("columns", [40, 80, 200])
def test_no_figure_is_cut_on_a_narrow_terminal(columns, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", str(columns))
    print_check(ROMEO)
    printed = capsys.readouterr().out
    assert "…" not in printed
    for row in (
        "quick_stop_deceleration 0x6085:00 UNSIGNED32 0.010472    +1   0      rad/s2",
        "LElbowRoll      1.2    12      0.036  0.108   0.120     0.060    0.324   0.180",
    ):
        assert row in printed


def test_gravity_is_shown_beside_what_the_motor_gives():
    lines = [line.split() for line in check(DESK_ARM).output.splitlines()]
    # 0.8 kg at 0.15 m, 1.3 rad off the vertical; 2.4 Nm/A times 2 A.
    for row in (
        "swing 12 80 1 2 2.4 +1 +1 0",
        "joint half-gap mrad level Nm limits rad gravity Nm end",
        "column 12 0.6 -1.40 +1.40 0.00 of 9.00 hold",
        "swing 8 0.5 -1.30 +1.30 1.13 of 4.80 brake",
    ):
        assert row.split() in lines, row


@pytest.mark.parametrize("folder", [ROMEO, DESK_ARM, SINGLE_JOINT])
def test_shipped_arms_hold_themselves(folder):
    output = check(folder).output
    assert output.endswith("config.yaml: good\n")
    assert "more than the motor can hold" not in output


@pytest.mark.parametrize("scaled", ["mass value", "xyz"])
def test_an_arm_in_grams_or_millimetres_is_told(tmp_path, scaled):
    folder = shutil.copytree(DESK_ARM, tmp_path / "arm")
    urdf = folder / "arm.urdf"
    urdf.write_text(
        re.sub(
            rf'({scaled}=")([^"]*)',
            lambda found: found[1] + " ".join(f"{1000 * float(x):g}" for x in found[2].split()),
            urdf.read_text(),
        )
    )
    result = check(folder)
    assert result.exit_code == 0
    *_, exchange, warning, good = result.output.splitlines()
    assert exchange.startswith("bus load")  # and no warning of the column: it is upright
    assert warning == (
        "swing: gravity is more than the motor can hold (1134 Nm of 4.8 Nm): "
        "are masses in kg and lengths in m?"
    )
    assert good.endswith("config.yaml: good")


def test_the_tables_of_the_arm_fit_into_80_columns():
    lines = check(ROMEO).output.splitlines()
    for title in (
        "wiring",
        "joints",
        "travel in rad, at worst, from a fault at full speed until the joint stands",
    ):
        start = next(i for i, line in enumerate(lines) if line.strip() == title)
        assert max(len(line.rstrip()) for line in lines[start : start + 9]) <= 80
