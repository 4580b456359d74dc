"""Choice of a drive's objects: properties of every dictionary, and names of single objects."""

import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.eds import ACCESS
from drivers.canopen.boot.data_sheet import DataSheet, find_object, load_data_sheet
from programs.contactd.drafts.choice import MEASURED, RULES, choose
from programs.contactd.drafts.drive import choices_of

WORDS = ("current", "actual", "value", "motor", "link", "position", "velocity", "torque", "encoder",
         "threshold", "demand", "auxiliary", "measured", "limit", "Homing", "2")  # fmt: skip
STANDARD = (0x6063, 0x6064, 0x6069, 0x606C, 0x6077, 0x6078, 0x607F, 0x6080, 0x6085, 0x60E4, 0x60FF)


def sheet_of(*rows: tuple[int, str, str, bool]) -> DataSheet:
    """EDS of 32-bit objects: index, name, access and PDO mapping."""
    text = "[1000]\nParameterName=Device type\nDataType=7\nAccessType=ro\n"
    for index, name, access, mapped in rows:
        text += f"[{index:X}]\nParameterName={name}\nDataType=4\nAccessType={access}\n"
        text += f"PDOMapping={int(mapped)}\n"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "drive.eds").write_text(text)
        return load_data_sheet(Path(folder) / "drive.eds")


@given(
    st.lists(
        st.tuples(
            st.integers(0x2000, 0x20FF) | st.sampled_from(STANDARD),
            st.lists(st.sampled_from(WORDS), min_size=1, max_size=5).map(" ".join),
            st.sampled_from(ACCESS),
            st.booleans(),
        ),
        max_size=25,
        unique_by=lambda row: row[0],
    )
)
def test_a_measurement_is_read_only_and_mappable_and_no_object_is_taken_twice(rows):
    sheet = sheet_of(*rows)
    choices = choices_of(sheet, {})
    taken = [choice.chosen.where for choice in choices.values() if choice.chosen]
    assert len(taken) == len(set(taken))
    for quantity, choice in choices.items():
        for one in (*([choice.chosen] if choice.chosen else []), *choice.others):
            variable = find_object(sheet, *one.where)
            measured = quantity in MEASURED
            assert variable.writable is not measured
            assert variable.pdo_mappable or not (measured or quantity == "target_velocity")
            assert not measured or one.index >= 0x6000 or not {"threshold", "demand", "limit"} & {
                *variable.name.lower().split()
            }  # fmt: skip


@pytest.mark.parametrize(
    ("quantity", "name", "taken"),
    [
        ("current", "Current actual value averaged", True),
        ("current", "current_actual_value", True),
        ("current", "MotorCurrentMeasured", True),
        ("current", "Motor current demand", False),
        ("current", "Current threshold for homing mode", False),
        ("current", "I_q", False),
        ("torque", "Torque actual value averaged", True),
        ("torque", "Torque sensor", False),
        ("motor_velocity", "Motor Speed", True),
        ("motor_velocity", "Velocity Error Window", False),
        ("link_position", "Load encoder position", True),
        ("link_position", "Auxiliary encoder position", True),
        ("link_position", "Auxiliary encoder captured position positive edge", False),
        ("link_position", "Dual encoder difference value", False),
        ("motor_position", "Motor Encoder Position", True),
        ("motor_position", "Set/change the actual motor position", False),
    ],
)
def test_measurements_are_chosen_by_their_names(quantity, name, taken):
    choice = choose(sheet_of((0x2001, name, "ro", True)), quantity)
    assert (choice.chosen is not None) is taken


@pytest.mark.parametrize("quantity", RULES)
def test_an_empty_dictionary_gives_no_choice(quantity):
    assert choose(sheet_of(), quantity).chosen is None
