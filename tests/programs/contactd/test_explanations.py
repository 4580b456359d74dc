"""Explanations of fields: every field that an owner fills in has one, and is found by its name."""

import msgspec
import pytest

from common.errors import ConfigurationError
from daemon.config.schema import Configuration, Joint, JointLimits, Levels
from drivers.can.settings import BusSettings
from drivers.canopen.settings import CanopenProfile, Quantity
from drivers.damiao.settings import DamiaoProfile
from drivers.robstride.settings import RobStrideProfile
from drivers.wiring import JointWiring
from programs.contactd.explanations import EXPLANATIONS, explain


def fields(kind: type[msgspec.Struct], prefix: str, *, but: tuple[str, ...] = ()) -> set[str]:
    return {f"{prefix}{name}" for name in kind.__struct_fields__ if name not in but}


def test_every_field_of_arms_and_drives_is_explained() -> None:
    wanted = {
        *("version", "name", "urdf", "period_ms", "estimator.learning"),
        *fields(BusSettings, "bus."),
        *fields(CanopenProfile, "drives."),
        "drives.make",
        *fields(DamiaoProfile, "drives."),
        *fields(RobStrideProfile, "drives."),
        *fields(Quantity, "drives."),
        *fields(Joint, "joints.", but=("wiring", "thresholds", "limits")),
        *fields(JointWiring, "joints.wiring."),
        *fields(Levels, "joints.thresholds."),
        *fields(JointLimits, "joints.limits."),
    }
    scales = {key for key in EXPLANATIONS if key.count(".") == 2 and key.endswith(".scale")}
    assert set(EXPLANATIONS) - scales == wanted
    assert {key.removesuffix(".scale") for key in scales} <= wanted
    assert "urdf" in Configuration.__struct_fields__


@pytest.mark.parametrize(
    ("field", "found"),
    [
        ("gear", ["joints.wiring.gear"]),
        ("wiring.gear", ["joints.wiring.gear"]),
        ("joints[1] (shoulder).torque_constant", ["joints.torque_constant"]),
        ("joints[1] (shoulder).wiring.gear:", ["joints.wiring.gear"]),
        ("drives.servo.link_position.scale", ["drives.link_position.scale"]),
        ("drives.servo.link_position.type", ["drives.type"]),
        ("drives.servo.tpdo.1", ["drives.tpdo"]),
        ("learning", ["estimator.learning"]),
        ("drives.DM4340.model", ["drives.model"]),
        ("drives.DM4340.torque_constant", ["drives.torque_constant"]),
        ("name", ["name", "joints.name"]),
        (
            "thresholds",
            [f"joints.thresholds.{x}" for x in ("contact", "collision", "per_speed", "least")],
        ),
    ],
)
def test_a_field_is_found_by_its_place(field: str, found: list[str]) -> None:
    assert list(explain(field)) == found


@pytest.mark.parametrize("field", ["", "xylophone", "[1]", "joints[1].xylophone"])
def test_an_unknown_field_is_refused_with_the_known_ones(field: str) -> None:
    with pytest.raises(ConfigurationError, match=r"no such field .* rotor_inertia.*configuration"):
        explain(field)


@pytest.mark.parametrize(
    ("field", "meant"),
    [
        ("gera", "gear"),
        ("joints.wiring.gaer", "gear"),
        ("joints[1] (shoulder).rotor_inertai:", "rotor_inertia"),
        ("half-gap", "half_gap"),
    ],
)
def test_a_misspelt_field_gets_a_suggestion(field: str, meant: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        explain(field)
    asked, _, rest = str(caught.value).partition("?")
    assert f" Did you mean {meant}" in asked
    assert rest.startswith(" All others are in docs/configuration.md")
