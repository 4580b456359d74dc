"""Installed service under this machine's systemd, against the simulated arm on a virtual bus.

`make system`, as root, on a machine that has no arm: contactd.service is started, killed and
frozen, and can0 made and deleted. Nothing is written but below /run. Only order and counts are
asserted, so that a slow virtual machine gives the same result.
"""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.stand import (
    CAN,
    CAN_BUS,
    EXAMPLES,
    SERVICE,
    TCP_BUS,
    Service,
    Simulator,
    run,
    write_robot,
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--system", action="store_true", help="use this machine's systemd and can0")
    parser.addoption("--package", help="install this Debian package on a machine that has none")
    parser.addoption("--upgrade", help="and update it to this one, which is newer")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    return None if config.getoption("--system", default=False) else True


def file_of(request: pytest.FixtureRequest, option: str) -> Path:
    given = request.config.getoption(option)
    if not given:
        pytest.skip(f"needs {option} FILE.deb")
    return Path(given).resolve(strict=True)


@pytest.fixture(scope="session")
def package(request: pytest.FixtureRequest) -> Path:
    """The package to install on this machine, which keeps nothing of what it had."""
    return file_of(request, "--package")


@pytest.fixture(scope="session")
def upgrade(request: pytest.FixtureRequest) -> Path:
    """The newer package."""
    return file_of(request, "--upgrade")


@pytest.fixture(scope="session", autouse=True)
def _machine(request: pytest.FixtureRequest) -> None:
    """Skip all where this cannot be, or must not be, tried."""
    if os.getuid() != 0:
        pytest.skip("needs root")
    if not Path("/run/systemd/system").exists():
        pytest.skip("needs systemd as the machine's service manager")
    if request.config.getoption("--package"):
        return
    if run("systemctl", "cat", SERVICE).returncode != 0:
        pytest.skip("needs an installed contactd: make install")
    state = run("systemctl", "is-active", SERVICE).stdout.strip()
    if state not in ("inactive", "failed"):
        pytest.skip(f"contactd.service is {state}: this machine has an arm in use")


@pytest.fixture(scope="session")
def vcan() -> bool:
    """Whether this kernel has virtual CAN interfaces."""
    run("modprobe", "vcan")
    made = run("ip", "link", "add", "contactd-probe", "type", "vcan").returncode == 0
    run("ip", "link", "delete", "contactd-probe")
    return made


@pytest.fixture
def can0(vcan: bool) -> Iterator[None]:
    """A virtual CAN interface of that name, up."""
    if not vcan:
        pytest.skip("needs virtual CAN interfaces (vcan)")
    about = run("ip", "-details", "link", "show", CAN)
    if about.returncode == 0 and "vcan" not in about.stdout:
        pytest.skip("can0 is a real bus")
    if about.returncode != 0:
        run("ip", "link", "add", CAN, "type", "vcan", check=True)
    run("ip", "link", "set", CAN, "up", check=True)
    yield
    run("ip", "link", "delete", CAN)


@pytest.fixture
def robot(request: pytest.FixtureRequest, vcan: bool) -> Iterator[Path]:
    """One joint, slow enough for any machine, in a folder that the service can read: on can0, or
    behind TCP where there is no virtual CAN."""
    if vcan:
        request.getfixturevalue("can0")
    folder = Path("/run/contactd-system-test")
    write_robot(folder, CAN_BUS if vcan else TCP_BUS)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture
def service(robot: Path, vcan: bool) -> Iterator[Service]:
    """The installed unit, made by a drop-in to run this robot; stopped and forgotten at the end."""
    made = Service(robot)
    made.configure()
    if not vcan:
        made.replace_bus(EXAMPLES / "bus-tcp.conf")
    yield made
    made.forget()


@pytest.fixture
def simulator(robot: Path) -> Iterator[Simulator]:
    """The drives of the robot, in a process of their own."""
    with Simulator(robot) as made:
        yield made
