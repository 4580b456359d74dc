"""Arm behind a TCP adapter, with the drop-in that comes with the program. Needs no CAN."""

import shutil
from pathlib import Path

import pytest

from tests.system.stand import EXAMPLES, SERVICE, TCP_BUS, Service, Simulator, run, write_robot


@pytest.fixture
def robot_behind_tcp(robot: Path) -> Path:
    """The same robot with another bus."""
    shutil.rmtree(robot)
    write_robot(robot, TCP_BUS)
    return robot


def test_with_the_drop_in_for_tcp_it_needs_no_can0(
    service: Service, robot_behind_tcp: Path
) -> None:
    service.replace_bus(EXAMPLES / "bus-tcp.conf")
    assert "can0" not in service.show("BindsTo")
    with Simulator(robot_behind_tcp):
        service.start()
        service.enable()
        assert "operation enabled" in service.wait_for_samples().drives
        service.stop()
        assert service.show("Result") == "success"


def test_without_it_the_sandbox_lets_nothing_out(
    service: Service, robot_behind_tcp: Path, tmp_path: Path
) -> None:
    service.configure("Restart=no")
    (tmp_path / "empty.conf").write_text("[Unit]\n")
    service.replace_bus(tmp_path / "empty.conf")
    with Simulator(robot_behind_tcp):
        assert run("systemctl", "start", SERVICE).returncode != 0
        assert service.show("ExecMainStatus") == "69"
    assert any("Address family not supported" in line for line in service.log())
