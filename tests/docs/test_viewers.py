"""Layouts for viewers: they show only what an export of the Romeo arm has, in the viewers' form."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from bench.rigs.lockstep import ROMEO
from daemon.config.load import load_robot
from programs.recordings.skeleton import skeleton_of

pytest.importorskip("foxglove")
from programs.recordings.foxglove import ArmValues, JointValues

VIEWERS = Path(__file__).parents[2] / "docs" / "viewers"
ROBOT = load_robot(ROMEO)
JOINTS = ROBOT.configuration.joint_names
FIELDS = {
    **{f"/joints/{name}": JointValues.__struct_fields__ for name in JOINTS},
    "/arm": ArmValues.__struct_fields__,
}


def test_plotjuggler_finds_every_curve_and_every_area() -> None:
    root = ET.parse(VIEWERS / "plotjuggler.xml").getroot()
    assert root.tag == "root"
    (window,) = root.findall("tabbed_widget")
    assert window.attrib == {"name": "Main Window", "parent": "main_window"}
    for tab in window.findall("Tab"):
        (splitter,) = tab.findall("Container/DockSplitter")
        areas = list(splitter)
        assert splitter.get("orientation") in {"|", "-"}
        assert splitter.get("count") == str(len(areas))
        sizes = [float(size) for size in splitter.get("sizes", "").split(";")]
        assert len(sizes) == len(areas)
        assert sum(sizes) == pytest.approx(1.0)
        assert all(area.tag == "DockArea" and area.find("plot") is not None for area in areas)
    curves = [curve.get("name", "").rpartition("/") for curve in root.iter("curve")]
    assert len(curves) == 3 * len(JOINTS)
    assert all(field in FIELDS[topic] for topic, _, field in curves)


def panels(tree: Any) -> list[str]:
    return [tree] if isinstance(tree, str) else panels(tree["first"]) + panels(tree["second"])


def test_foxglove_finds_every_panel_and_every_value() -> None:
    layout = json.loads((VIEWERS / "foxglove.json").read_text())
    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])
    values = [
        path["value"].rpartition(".")
        for panel in layout["configById"].values()
        for path in panel.get("paths", ())
    ]
    assert len(values) == 3 * len(JOINTS) + 2
    assert all(field in FIELDS[topic] for topic, _, field in values)
    view = layout["configById"]["3D!arm"]
    frames = skeleton_of(ROBOT.urdf).frames
    assert view["followTf"] in {frame.parent for frame in frames}
    assert list(view["topics"]) == ["/scene", "/touch"]
    assert layout["configById"]["RosOut!log"]["topicToRender"] == "/log"
