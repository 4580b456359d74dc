"""Masses of a URDF: those that are refused, and those that pinocchio reads as they are."""

import pinocchio as pin
import pytest

from common.errors import ModelError
from estimator.model import Model
from estimator.urdf import joint_ranges, moved_links

MASS = '<mass value="1.5"/>'
ORIGIN = '<origin xyz="0 0 -0.2" rpy="0 0 0"/>'
INERTIA = '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.0004"/>'
TOOL = '<joint name="flange" type="fixed"><parent link="bar"/><child link="tool"/></joint>'
ARM = f"""<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <joint name="swing" type="revolute">
    <parent link="base"/>
    <child link="bar"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" velocity="3.0" effort="12.0"/>
  </joint>
  <link name="bar">
    <inertial>
      {ORIGIN}
      {MASS}
      {INERTIA}
    </inertial>
  </link>
</robot>
"""


def with_tool(inertial: str) -> str:
    """With a link that is fixed to the one that moves."""
    return ARM.replace("</robot>", f'{TOOL}\n<link name="tool">{inertial}</link>\n</robot>')


def test_lines_count_from_the_beginning_of_the_file() -> None:
    text = ARM.replace("<robot", "<!-- one\n two -->\n<robot").replace(MASS, '<mass value="x"/>')
    with pytest.raises(ModelError, match="line 15: <mass"):
        moved_links(text)


@pytest.mark.parametrize(
    ("text", "kg"),
    [
        (ARM, 1.5),
        (ARM.replace(MASS, '<mass value=" +1.5E0"/>'), 1.5),
        (ARM.replace(MASS, '<mass value=".25"/>'), 0.25),
        (ARM.replace(ORIGIN, ""), 1.5),
        (ARM.replace(ORIGIN, '<origin xyz=" 0  0 1."/>'), 1.5),
        (ARM.replace(INERTIA, INERTIA.replace("0.0004", "-1e-9")), 1.5),  # rounding
        (ARM.replace("<robot", '<robot xmlns="http://a.b" xmlns:x="http://c"'), 1.5),
        (ARM.replace('<link name="base"/>', '<link name="base"/><gazebo><a:b/></gazebo>'), 1.5),
        (with_tool(""), 1.5),
        (with_tool(f'<inertial><mass value="0"/>{INERTIA}</inertial>'), 1.5),
        (with_tool(f"<inertial>{MASS}{INERTIA}</inertial>"), 3.0),
        ("\ufeff" + ARM, 1.5),
    ],
)
def test_accepted_masses_are_those_that_pinocchio_reads(text: str, kg: float, capfd) -> None:
    assert sum(link.mass for link in moved_links(text)) == kg
    assert pin.buildModelFromXML(text).inertias[1].mass == kg
    assert Model(text, ["swing"]).n == 1
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<link name="base"/>', '<link name="base">{}</link>'),
        (
            "</robot>",
            '<joint name="foot" type="fixed"><parent link="base"/><child link="stand"/></joint>'
            '<link name="stand">{}</link></robot>',
        ),
    ],
)
def test_masses_of_links_at_rest_are_not_checked(old: str, new: str) -> None:
    inertial = f'<inertial><mass value="-4"/>{INERTIA}</inertial>'
    text = ARM.replace(old, new.format(inertial))
    assert sum(link.mass for link in moved_links(text)) == 1.5
    assert Model(text, ["swing"]).n == 1


BAR, SWING = "link 'bar', line 1", "joint 'swing', line "
LIMIT = '<limit lower="-1.5" upper="1.5" velocity="3.0" effort="12.0"/>'


@pytest.mark.parametrize(
    ("where", "old", "new", "message"),
    [
        (
            BAR,
            MASS,
            '<mass value="1.5 kg"/>',
            '<mass value="1.5 kg">: must be one finite number and',
        ),
        (BAR, MASS, '<mass value="1.5 "/>', "must be one finite number and nothing else"),
        (BAR, MASS, '<mass value="1,5"/>', "must be one finite number"),
        (BAR, MASS, '<mass value="1_5"/>', "must be one finite number"),
        (BAR, MASS, '<mass value="nan"/>', "must be one finite number"),
        (BAR, MASS, '<mass value="1e999"/>', 'value="1e999">: must be one finite number'),
        (BAR, MASS, '<mass value=""/>', "must be one finite number"),
        (BAR, MASS, "<mass/>", "line 13: its <mass> has no value"),
        (BAR, MASS, '<mass value="-0.1"/>', "line 13: its mass of -0.1 kg must not be negative"),
        (BAR, MASS, "", "line 11: its <inertial> has no <mass> but <origin>, <inertia>"),
        (BAR, INERTIA, "", "no <inertia> but <origin>, <mass>; allowed are both"),
        (BAR, f"{ORIGIN}\n      {MASS}\n      {INERTIA}", "", "has no <mass> but nothing"),
        (BAR, 'ixy="0"', "", "line 14: its <inertia> has no ixy"),
        (BAR, 'ixy="0"', 'ixy="-"', '<inertia ixy="-">: must be one finite number'),
        (BAR, 'izz="0.0004"', 'izz="inf"', '<inertia izz="inf">: must be one finite number'),
        (
            BAR,
            'izz="0.0004"',
            'izz="-0.0004"',
            "principal moment of -0.0004 kg m2; none may be neg",
        ),
        (BAR, 'ixy="0"', 'ixy="0.03"', "principal moment of -0.01 kg m2"),
        (BAR, 'xyz="0 0 -0.2"', 'xyz="0 0"', '<origin xyz="0 0">: must be three finite numbers'),
        (BAR, 'xyz="0 0 -0.2"', 'xyz="0 0 a"', "must be three finite numbers"),
        (BAR, 'rpy="0 0 0"', 'rpy="0 0 1e999"', "must be three finite numbers"),
        (SWING, LIMIT, "", "line 4: it is revolute, and has no <limit>, which needs lower"),
        (SWING, ' effort="12.0"', "", "line 8: its <limit> has no effort"),
        (SWING, ' velocity="3.0"', "", "line 8: its <limit> has no velocity"),
        (SWING, "12.0", "12,0", 'line 8: <limit effort="12,0">: must be one finite number'),
        (SWING, '<parent link="base"', '<parent link="bases"', "no link 'bases' for its <parent>"),
        (SWING, '<child link="bar"', '<child link="bars"', "no link 'bars' for its <child>"),
        ("", "</robot>", '<xacro:macro name="a"/></robot>', "`xacro:macro` is xacro: expand it"),
        ("", MASS, '<mass value="${m}"/>', "`${m}` is xacro: expand it first"),
    ],
)
def test_a_body_joint_or_macro_that_cannot_be_read_is_named_with_its_line(
    where: str, old: str, new: str, message: str, capfd
) -> None:
    """And pinocchio's parser prints nothing."""
    assert old in ARM
    with pytest.raises(ModelError) as caught:
        Model(ARM.replace(old, new), ["swing"])
    assert str(caught.value).startswith(f"the URDF: {where}")
    assert message in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_wrong_mass_of_a_fixed_tool_is_refused() -> None:
    text = with_tool('<inertial><mass value="1 kg"/></inertial>')
    with pytest.raises(ModelError, match="link 'tool', line 18: <mass"):
        moved_links(text)


@pytest.mark.parametrize("text", ["", "<robot", ARM + "more", ARM.replace("arm", "a & b")])
def test_text_that_is_no_xml_is_refused(text: str) -> None:
    with pytest.raises(ModelError, match=r"not XML that can be read: .*line"):
        moved_links(text)


@pytest.mark.parametrize("effort", ["12", " 5", "+5", "1e3", "5.", "inf", "nan", "", "5 ", "1_0"])
def test_limits_are_accepted_as_pinocchio_reads_them(effort: str) -> None:
    text = ARM.replace('"12.0"', f'"{effort}"')
    try:
        pin.buildModelFromXML(text)
    except ValueError:
        with pytest.raises(ModelError):
            moved_links(text)
    else:
        moved_links(text)


def test_the_kind_of_a_joint_that_mimics_another_is_mimic() -> None:
    text = ARM.replace("</joint>", '<mimic joint="other"/></joint>')
    assert [one.kind for one in joint_ranges(text)] == ["mimic"]


def test_a_tab_that_only_pinocchio_refuses_is_named() -> None:
    with pytest.raises(ModelError, match=r"reads only 0 of the 1\.5 kg that move: no tab"):
        Model(ARM.replace("0 0 -0.2", "0\t0\t-0.2"), ["swing"])
