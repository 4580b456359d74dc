"""`make install` below another root, without its environment; and `make uninstall`."""

import re
import shutil
import subprocess
from pathlib import Path

import msgspec
import pytest

from daemon.config.load import load_robot
from daemon.config.schema import FaultSettings
from daemon.ending import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(not shutil.which("make"), reason="needs make")


def make(target: str, root: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    words = ["make", "-C", str(ROOT), target, f"DESTDIR={root}"]
    words += [f"{name}={value}" for name, value in variables.items()]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def files(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if not path.is_dir()}


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """What `make install` leaves, with next to nothing for an environment."""
    assert make("install-files", tmp_path).returncode == 0
    environment = tmp_path / "opt/contactd"
    (environment / "bin").mkdir()
    for name in (
        "bin/contactd",
        "bin/contactctl",
        "bin/contactd-web",
        "bin/contactd-zenoh",
        "pyvenv.cfg",
    ):
        (environment / name).touch()
    return tmp_path


def test_the_example_arm_is_installed_on_can0(installed: Path) -> None:
    robot = load_robot(installed / "etc/contactd")
    # What was found on the simulated drives is nobody's who installs it.
    assert not (installed / "etc/contactd/identified.yaml").exists()
    bus = robot.configuration.bus
    assert (bus.interface, bus.channel) == ("socketcan", "can0")
    network = (installed / "usr/local/lib/systemd/network/can0.network").read_text()
    assert f"BitRate={bus.bitrate}\n" in network


def test_the_end_of_the_daemon_fits_before_systemd_kills_it(installed: Path) -> None:
    unit = (installed / "usr/local/lib/systemd/system/contactd.service").read_text()
    (patience_s,) = re.findall(r"^TimeoutStopSec=(\d+)$", unit, re.MULTILINE)
    fields = msgspec.inspect.type_info(FaultSettings).fields
    longest = next(field.type.le for field in fields if field.name == "stop_timeout_s")
    # Stopping, and the drives' states after it; what is left over is for telling them that we go.
    assert longest + 2 * PATIENCE_S < float(patience_s)


@pytest.mark.parametrize("name", ["contactd.service.d/bus.conf", "examples/bus-serial.conf"])
def test_another_interface_is_waited_for_as_the_head_of_its_file_says(name: str) -> None:
    """docs/installing.md leaves it to the head, from which the device is copied into a shell."""
    head, _, body = (ROOT / "systemd" / name).read_text().partition("\n[Unit]\n")
    (told,) = re.findall(r"^#   systemctl add-wants (\S+) contactd\.service$", head, re.MULTILINE)
    (bound,) = re.findall(r"^BindsTo=(\S+)$", body, re.MULTILINE)
    assert told == bound.replace("can0", "can1")
    assert re.search(r"^#   systemctl daemon-reload$", head, re.MULTILINE)


def test_an_edited_configuration_is_never_touched(installed: Path) -> None:
    mine = installed / "etc/contactd/config.yaml"
    mine.write_text("mine\n")
    (installed / "etc/contactd/drive.eds").unlink()
    again = make("install-files", installed)
    assert "kept as it is" in again.stdout
    assert mine.read_text() == "mine\n"
    assert not (installed / "etc/contactd/drive.eds").exists()


def test_uninstall_leaves_the_configuration_and_nothing_else(installed: Path) -> None:
    before = files(installed / "etc/contactd")
    assert before
    done = make("uninstall", installed)
    assert done.returncode == 0, done.stderr
    assert files(installed) == {f"etc/contactd/{name}" for name in before}


def test_another_prefix_is_where_everything_points_to(tmp_path: Path) -> None:
    assert make("install-files", tmp_path, PREFIX="/srv/feel").returncode == 0
    unit = (tmp_path / "usr/local/lib/systemd/system/contactd.service").read_text()
    assert "ExecStart=/srv/feel/bin/contactd run /etc/contactd\n" in unit
    assert "/opt/contactd" not in unit
    link = tmp_path / "usr/local/bin/contactctl"
    assert link.readlink() == Path("/srv/feel/bin/contactctl")


@pytest.mark.parametrize("target", ["install-env", "uninstall"])
def test_a_prefix_that_is_no_environment_of_contactd_is_left_alone(
    tmp_path: Path, target: str
) -> None:
    strange = tmp_path / "usr/local/bin/something"
    strange.parent.mkdir(parents=True)
    strange.touch()
    done = make(target, tmp_path, PREFIX="/usr/local")
    assert done.returncode != 0
    assert strange.exists()
    assert "choose another PREFIX" in done.stdout
