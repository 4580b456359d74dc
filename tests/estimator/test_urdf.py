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


def test_the_line_after_leading_comments_is_the_files() -> None:
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
def test_what_is_let_through_is_what_pinocchio_reads(text: str, kg: float, capfd) -> None:
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
def test_what_rests_may_weigh_what_it_likes(old: str, new: str) -> None:
    inertial = f'<inertial><mass value="-4"/>{INERTIA}</inertial>'
    text = ARM.replace(old, new.format(inertial))
    assert sum(link.mass for link in moved_links(text)) == 1.5
    assert Model(text, ["swing"]).n == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (MASS, '<mass value="1.5 kg"/>', '<mass value="1.5 kg">: must be one finite number and'),
        (MASS, '<mass value="1.5 "/>', "must be one finite number and nothing else"),
        (MASS, '<mass value="1,5"/>', "must be one finite number"),
        (MASS, '<mass value="1_5"/>', "must be one finite number"),
        (MASS, '<mass value="nan"/>', "must be one finite number"),
        (MASS, '<mass value="1e999"/>', 'value="1e999">: must be one finite number'),
        (MASS, '<mass value=""/>', "must be one finite number"),
        (MASS, "<mass/>", "line 13: its <mass> has no value"),
        (MASS, '<mass value="-0.1"/>', "line 13: its mass of -0.1 kg must not be negative"),
        (MASS, "", "line 11: its <inertial> has no <mass> but <origin>, <inertia>"),
        (INERTIA, "", "no <inertia> but <origin>, <mass>; allowed are both"),
        (f"{ORIGIN}\n      {MASS}\n      {INERTIA}", "", "has no <mass> but nothing"),
        ('ixy="0"', "", "line 14: its <inertia> has no ixy"),
        ('ixy="0"', 'ixy="-"', '<inertia ixy="-">: must be one finite number'),
        ('izz="0.0004"', 'izz="inf"', '<inertia izz="inf">: must be one finite number'),
        ('izz="0.0004"', 'izz="-0.0004"', "principal moment of -0.0004 kg m2; none may be neg"),
        ('ixy="0"', 'ixy="0.03"', "principal moment of -0.01 kg m2"),
        ('xyz="0 0 -0.2"', 'xyz="0 0"', '<origin xyz="0 0">: must be three finite numbers'),
        ('xyz="0 0 -0.2"', 'xyz="0 0 a"', "must be three finite numbers"),
        ('rpy="0 0 0"', 'rpy="0 0 1e999"', "must be three finite numbers"),
    ],
)
def test_no_body_is_like_that(old: str, new: str, message: str, capfd) -> None:
    assert old in ARM
    with pytest.raises(ModelError) as caught:
        Model(ARM.replace(old, new), ["swing"])
    assert str(caught.value).startswith("the URDF: link 'bar', line 1")
    assert message in str(caught.value)
    assert capfd.readouterr().err == ""  # where pinocchio's parser would have its say


def test_a_tool_that_is_fixed_to_what_moves() -> None:
    text = with_tool('<inertial><mass value="1 kg"/></inertial>')
    with pytest.raises(ModelError, match="link 'tool', line 18: <mass"):
        moved_links(text)


@pytest.mark.parametrize("text", ["", "<robot", ARM + "more", ARM.replace("arm", "a & b")])
def test_no_xml(text: str) -> None:
    with pytest.raises(ModelError, match=r"not XML that can be read: .*line"):
        moved_links(text)


def test_a_joint_between_links_that_are_not_there(capfd) -> None:
    for role, name in (("parent", "base"), ("child", "bar")):
        text = ARM.replace(f'<{role} link="{name}"', f'<{role} link="{name}s"')
        assert text != ARM
        with pytest.raises(
            ModelError, match=rf"'swing', line \d+: no link '{name}s' for its <{role}>"
        ):
            Model(text, ["swing"])
    assert capfd.readouterr().err == ""


LIMIT = '<limit lower="-1.5" upper="1.5" velocity="3.0" effort="12.0"/>'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (LIMIT, "", r"'swing', line 4: it is revolute, and has no <limit>, which needs lower"),
        (' effort="12.0"', "", r"'swing', line 8: its <limit> has no effort"),
        (' velocity="3.0"', "", r"'swing', line 8: its <limit> has no velocity"),
        ("12.0", "12,0", r"'swing', line 8: <limit effort=\"12,0\">: must be one finite number"),
    ],
)
def test_a_joint_without_limits_is_named_and_the_parser_says_nothing(
    old: str, new: str, message: str, capfd
) -> None:
    text = ARM.replace(old, new)
    assert text != ARM
    with pytest.raises(ModelError, match=message):
        Model(text, ["swing"])
    said = capfd.readouterr()
    assert (said.out, said.err) == ("", "")


@pytest.mark.parametrize("effort", ["12", " 5", "+5", "1e3", "5.", "inf", "nan", "", "5 ", "1_0"])
def test_limits_are_let_through_as_pinocchio_reads_them(effort: str) -> None:
    text = ARM.replace('"12.0"', f'"{effort}"')
    try:
        pin.buildModelFromXML(text)
    except ValueError:
        with pytest.raises(ModelError):
            moved_links(text)
    else:
        moved_links(text)


def test_tabs_that_only_pinocchio_sees() -> None:
    with pytest.raises(ModelError, match=r"reads only 0 of the 1\.5 kg that move: no tab"):
        Model(ARM.replace("0 0 -0.2", "0\t0\t-0.2"), ["swing"])


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("</robot>", '<xacro:macro name="a"/></robot>', "`xacro:macro`"),
        (MASS, '<mass value="${m}"/>', "`${m}`"),
    ],
)
def test_macros_are_to_be_expanded_first(old: str, new: str, named: str) -> None:
    with pytest.raises(ModelError, match=r"is xacro: expand it first") as raised:
        moved_links(ARM.replace(old, new))
    assert named in str(raised.value)


def test_a_joint_that_mimics_another_is_called_so() -> None:
    text = ARM.replace("</joint>", '<mimic joint="other"/></joint>')
    assert [one.kind for one in joint_ranges(text)] == ["mimic"]
