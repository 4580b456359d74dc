"""A known force at the tool against the newtons said, and torque constants off on purpose."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import ROMEO, describe, lockstep_rig
from daemon.config.load import load_robot
from daemon.protocol.state import STATE_FORMAT, Snapshot, State
from identification.known_force import MOST, HeldPose, correct
from programs.clients.log_writer import LogWriter
from programs.contactd.contactd import main
from simulator.hand_script import Give

MODEL = load_robot(ROMEO).model
POSES = (
    (1.2, -0.2, 0.2, -0.8, -1.6, -0.1, -0.3),
    (0.6, 0.3, -0.6, -1.2, -1.2, 0.2, 0.2),
    (0.5, -0.1, -0.3, -1.0, -1.7, 0.4, -0.4),
)
FORCE = np.array([0.0, 0.0, -20.0])
FRICTION = np.full(7, 0.03)


def poses(constants: Any, witness: Any = None) -> list[HeldPose]:
    """Residuals of a force, by torque constants that are so many times those of the arm."""
    found = []
    for k, q in enumerate(POSES):
        J = MODEL.tool_jacobian(np.array(q))
        by = constants if k < 2 or witness is None else witness
        found.append(HeldPose(FORCE, J.T @ FORCE * by + 0.01 * (-1.0) ** k, FRICTION, J))
    return found


def test_constants_are_corrected_as_far_as_friction_lets_be_known() -> None:
    by = np.array([1.0, 1.0, 1.05, 1.0, 1.0, 0.95, 1.0])
    found = correct(poses(by))
    sure = np.isfinite(found.bound)
    assert sure[[2, 5]].all()
    assert np.all(np.abs(found.factor - 1.0 / by)[sure] <= found.bound[sure])
    assert found.proposed[2] < 1.0 < found.proposed[5]
    nearer = np.abs(found.proposed - 1.0 / by) <= np.abs(1.0 - 1.0 / by) + 1e-9
    assert np.all(nearer)
    assert np.all(found.proposed[~sure] == 1.0)
    assert found.witnessed


@pytest.mark.parametrize("by", [0.6, 2.0, -1.0])
def test_nothing_is_proposed_where_it_must_be_the_mass(by: float) -> None:
    found = correct(poses(np.full(7, by)))
    assert abs(found.factor[0] - 1.0) - found.bound[0] > MOST
    assert found.beyond[0]
    assert np.all(found.proposed == 1.0)


def test_a_witness_that_shows_otherwise_does_not_confirm() -> None:
    off = np.full(7, 0.94)
    assert correct(poses(off)).witnessed
    for witness in (np.full(7, 1.06), np.ones(7)):
        found = correct(poses(off, witness=witness))
        assert not found.beyond.any()
        assert found.proposed.max() > 1.0
        assert not found.witnessed


def recorded(path: Path, pose: tuple[float, ...], mass: float) -> None:
    """A mass hung at the simulated tool after three seconds; constants are 8 % off."""

    def there(*given: Any) -> Any:
        arm = describe(*given)
        pairs = zip(arm.joints, pose, strict=True)
        return replace(arm, joints=tuple(replace(j, initial_position=q) for j, q in pairs))

    def off(settings: Any) -> Any:
        mismatch = msgspec.structs.replace(settings.mismatch, torque_constant=8.0)
        return msgspec.structs.replace(settings, mismatch=mismatch)

    with lockstep_rig(described=there, simulate=off) as rig, path.open("wb") as stream:
        rig.enable()
        rig.run(1.0)
        states = list(rig.states(3.0))
        rig.arm.hand.take(Give(at_s=0.0, mass=mass))
        states += rig.states(4.0)
        c = rig.robot.configuration
        context = Snapshot(
            format=STATE_FORMAT, joints=c.joint_names, half_gap=[], period_s=c.period_s, tick=0,
            thresholds=[joint.thresholds.contact for joint in c.joints], memory={},
            configuration="", urdf=rig.robot.urdf, program="", wrench_axes=MODEL.hand,
        )  # fmt: skip
        log = LogWriter(stream, "the test")
        log.write(Snapshot, msgspec.json.encode(context), 0.0)
        for state in states:
            log.write(State, msgspec.json.encode(state), state.time_s)
        log.finish()


def test_the_command_on_recordings_of_a_mass(tmp_path: Path) -> None:
    files = [tmp_path / f"{k}.mcap" for k in range(3)]
    for file, pose in zip(files, POSES, strict=True):
        recorded(file, pose, 1.0)
    words = ["identify", "wrench", "--mass", "1", *map(str, files)]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    newtons = [[float(part) for part in line.split()[2:7:2]] for line in lines[1:4]]
    assert np.abs(newtons).max() < 2.0
    proposals = {line.split()[0]: float(line.split()[-1]) for line in lines if " times 0." in line}
    assert proposals.keys() == {"LWristYaw"}  # whose constant is 0.92 of the configured
    assert 0.92 < proposals["LWristYaw"] < 1.0
    for given, answer in (
        (files[:1], "3 poses"),
        ([files[0], files[1], files[0]], "differ pairwise by 0.3 rad"),
    ):
        assert answer in CliRunner().invoke(main, [*words[:4], *map(str, given)]).output
    wrong = CliRunner().invoke(main, ["identify", "wrench", "--mass", "2", *map(str, files)])
    assert "change nothing" in wrong.output
    assert " times 1." not in wrong.output
    assert CliRunner().invoke(main, [*words[:2], str(files[0])]).exit_code == 2


def test_of_a_weight_that_hardly_shows_it_is_said_how_much_does(tmp_path: Path) -> None:
    hanging = (1.57, -0.21, 0.16, -0.29, -2.0, -0.04, -0.27)  # along its last link
    recorded(tmp_path / "down.mcap", hanging, 1.0)
    words = ["identify", "wrench", "--mass", "1", str(tmp_path / "down.mcap")]
    said = CliRunner().invoke(main, words).output
    assert re.search(r"N, of 9\.8, of which [0-3]\.\d are observable; along x not", said), said


def test_an_arm_that_gives_way_is_refused(tmp_path: Path) -> None:
    recorded(tmp_path / "heavy.mcap", POSES[1], 1.5)
    result = CliRunner().invoke(
        main, ["identify", "wrench", "--mass", "1.5", str(tmp_path / "heavy.mcap")]
    )
    assert result.exit_code == 65
    assert "it has to hold" in result.output
