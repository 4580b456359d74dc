"""`make install` below another root, without its environment; and `make uninstall`."""

import re
import shutil
import subprocess
from pathlib import Path

import msgspec
import pytest

from daemon.config.load import load_robot
from daemon.config.schema import FaultSettings
from daemon.shutdown import TIMEOUT_S

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(not shutil.which("make"), reason="needs make")


def make(
    target: str, root: Path, umask: int = 0o022, clone: Path = ROOT, **variables: str
) -> subprocess.CompletedProcess[str]:
    words = ["make", "-C", str(clone), target, f"DESTDIR={root}"]
    words += [f"{name}={value}" for name, value in variables.items()]
    return subprocess.run(words, capture_output=True, text=True, check=False, umask=umask)


def files(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if not path.is_dir()}


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """Files that `make install` leaves, with next to nothing for an environment."""
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
    # What was found on the simulated drives is not for who installs it.
    assert not (installed / "etc/contactd/identified.yaml").exists()
    bus = robot.configuration.bus
    assert (bus.interface, bus.channel) == ("socketcan", "can0")
    network = (installed / "usr/local/lib/systemd/network/can0.network").read_text()
    assert f"BitRate={bus.bitrate}\n" in network


def test_the_end_of_the_daemon_fits_before_systemd_kills_it(installed: Path) -> None:
    unit = (installed / "usr/local/lib/systemd/system/contactd.service").read_text()
    (timeout_s,) = re.findall(r"^TimeoutStopSec=(\d+)$", unit, re.MULTILINE)
    fields = msgspec.inspect.type_info(FaultSettings).fields
    longest = next(field.type.le for field in fields if field.name == "stop_timeout_s")
    # Stopping, and the drives' states after it; what is left over is for telling them that we go.
    assert longest + 2 * TIMEOUT_S < float(timeout_s)


@pytest.mark.parametrize("name", ["contactd.service.d/bus.conf", "examples/bus-serial.conf"])
def test_another_interface_is_waited_for_as_the_head_of_its_file_says(name: str) -> None:
    """docs/installing.md leaves it to the head, from which the device is copied into a shell."""
    head, _, body = (ROOT / "systemd" / name).read_text().partition("\n[Unit]\n")
    (reported,) = re.findall(
        r"^#   systemctl add-wants (\S+) contactd\.service$", head, re.MULTILINE
    )
    (bound,) = re.findall(r"^BindsTo=(\S+)$", body, re.MULTILINE)
    assert reported == bound.replace("can0", "can1")
    assert re.search(r"^#   systemctl daemon-reload$", head, re.MULTILINE)


def test_an_edited_configuration_is_never_touched(installed: Path) -> None:
    mine = installed / "etc/contactd/config.yaml"
    mine.write_text("mine\n")
    (installed / "etc/contactd/drive.eds").unlink()
    again = make("install-files", installed)
    assert "is kept" in again.stdout
    assert mine.read_text() == "mine\n"
    assert not (installed / "etc/contactd/drive.eds").exists()


def test_uninstall_leaves_the_configuration_and_nothing_else(installed: Path) -> None:
    before = files(installed / "etc/contactd")
    assert before
    half_made = installed / "opt/contactd.new/pyvenv.cfg"  # by an install that failed
    half_made.parent.mkdir()
    half_made.touch()
    done = make("uninstall", installed)
    assert done.returncode == 0, done.stderr
    assert files(installed) == {f"etc/contactd/{name}" for name in before}
    assert not (installed / "usr/local/lib/systemd").exists()
    assert not (installed / "usr/local/lib/sysusers.d").exists()


def test_a_folder_that_others_use_is_left(installed: Path) -> None:
    other = installed / "usr/local/lib/systemd/system/other.service"
    other.touch()
    assert make("uninstall", installed).returncode == 0
    assert other.exists()


@pytest.mark.parametrize("umask", [0o077, 0o027])
def test_whatever_the_umask_everybody_may_read_what_is_installed(
    tmp_path: Path, umask: int
) -> None:
    done = make("install-files", tmp_path, umask)
    assert done.returncode == 0, done.stderr
    for path in tmp_path.rglob("*"):
        if not path.is_symlink():
            assert path.stat().st_mode & (0o005 if path.is_dir() else 0o004), path
            assert not path.stat().st_mode & 0o022, path


@pytest.fixture
def my_arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot's folder, with what collects in one; its EDS is a link to another's."""
    folder = tmp_path_factory.mktemp("robots") / "my_arm"
    shutil.copytree(ROOT / "configs/romeo_left_arm", folder)
    (folder / "touch.mcap").touch()
    (folder / "identify").mkdir()
    (folder / "identify/strokes.mcap").touch()
    (folder / "drive.eds").unlink()
    (folder / "drive.eds").symlink_to(ROOT / "configs/romeo_left_arm/drive.eds")
    return folder


def test_the_folder_of_a_robot_is_installed_and_kept(tmp_path: Path, my_arm: Path) -> None:
    done = make("install-files", tmp_path, ROBOT=str(my_arm))
    assert done.returncode == 0, done.stderr
    there = tmp_path / "etc/contactd"
    assert files(there) == files(my_arm) - {"touch.mcap", "identify/strokes.mcap"}
    assert load_robot(there).text == (my_arm / "config.yaml").read_text()
    assert not (there / "drive.eds").is_symlink()
    identified = (there / "identified.yaml").read_text()
    assert identified == (my_arm / "identified.yaml").read_text()
    (my_arm / "identified.yaml").write_text("another\n")
    again = make("install-files", tmp_path, ROBOT=str(my_arm))
    assert f"is kept; ROBOT={my_arm} is not copied" in again.stdout
    assert (there / "identified.yaml").read_text() == identified


def test_of_configs_only_the_examples_are_installed(tmp_path: Path, my_arm: Path) -> None:
    clone = tmp_path / "clone"
    for name in ("configs", "systemd"):
        shutil.copytree(ROOT / name, clone / name)
    (clone / "docs").mkdir()
    shutil.copy(ROOT / "Makefile", clone)
    shutil.move(my_arm, clone / "configs/my_arm")
    (clone / "configs/desk_arm/touch.mcap").touch()
    (clone / "configs/desk_arm/identify").mkdir()
    (clone / "configs/desk_arm/identify/strokes.mcap").touch()
    assert make("install-files", tmp_path / "root", clone=clone).returncode == 0
    examples = tmp_path / "root/opt/contactd/share/contactd/configs"
    assert not list(examples.rglob("*.mcap"))
    names = {path.name for path in examples.iterdir()}
    assert names == {"beam_arm", "desk_arm", "openarm_left", "romeo_left_arm", "single_joint"}
    for name in names:
        load_robot(examples / name)


@pytest.mark.parametrize("target", ["install-files", "install-env"])
def test_a_folder_that_is_no_robot_is_refused_before_anything_is_done(
    tmp_path: Path, target: str
) -> None:
    done = make(target, tmp_path, ROBOT="configs")
    assert done.returncode != 0
    assert "ROBOT=configs: config.yaml is missing" in done.stdout
    assert not list(tmp_path.iterdir())


def test_another_prefix_is_where_everything_points_to(tmp_path: Path) -> None:
    assert make("install-files", tmp_path, PREFIX="/srv/feel").returncode == 0
    unit = (tmp_path / "usr/local/lib/systemd/system/contactd.service").read_text()
    assert "ExecStart=/srv/feel/bin/contactd run /etc/contactd\n" in unit
    assert "ExecReload=/srv/feel/bin/contactctl reload\n" in unit
    assert "/opt/contactd" not in unit
    for name in (
        "bin/contactctl",
        "share/man/man1/contactctl.1",
        "share/zsh/site-functions/_contactd",
    ):
        assert (tmp_path / "usr/local" / name).readlink() == Path("/srv/feel") / name


def test_for_a_package_all_is_below_usr_and_nothing_in_etc(tmp_path: Path) -> None:
    assert make("install-service", tmp_path, LOCAL="/usr").returncode == 0
    there = files(tmp_path)
    assert {name.split("/")[0] for name in there} == {"opt", "usr"}
    assert not [name for name in there if name.startswith("usr/local")]
    for name in (
        "bin/contactctl",
        "lib/systemd/system/contactd.service",
        "lib/sysusers.d/contactd.conf",
        "share/man/man1/contactctl.1",
        "share/zsh/vendor-completions/_contactctl",
    ):
        assert f"usr/{name}" in there


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
