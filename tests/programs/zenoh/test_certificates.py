"""The worked example of docs/ros.md: certificates by openssl, and who may what at a router."""

import contextlib
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from click.testing import CliRunner
from zenoh import ext

from programs.contactd import contactd
from programs.zenoh.arming import SET_BOOL
from programs.zenoh.names import Distro, Endpoint, Kind, Node, Qos, attachment, gid_of
from programs.zenoh.services import TRIGGER, endpoint
from tests.programs.zenoh.bridge import Bridge, until
from tests.programs.zenoh.zenoh_router import free_port

EXAMPLES = Path(__file__).parents[3] / "systemd/examples"
NODE = Node(0, "/left_arm", "contactd", Distro.JAZZY)

pytestmark = pytest.mark.skipif(not shutil.which("openssl"), reason="needs openssl")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with certificates of all, and of a stranger with a CA of its own."""
    made = tmp_path_factory.mktemp("etc")
    names = ["localhost", "arm", "planner", "screen", "visitor"]
    script = str(EXAMPLES / "zenoh-certificates.sh")
    subprocess.run([script, *names], cwd=made, check=True, capture_output=True)
    (made / "elsewhere").mkdir()
    subprocess.run([script, "planner"], cwd=made / "elsewhere", check=True, capture_output=True)
    return made


def example(name: str, folder: Path, port: int, who: str) -> str:
    """The example's text for this folder, at this port, and as another than the arm."""
    text = (EXAMPLES / name).read_text()
    text = text.replace("/etc/contactd/arm.", f"/etc/contactd/{who}.")
    text = text.replace("/etc/contactd/ca.pem", f"{folder}/ca.pem").replace("[::]", "127.0.0.1")
    return (
        text.replace("/etc/contactd", str(folder))
        .replace("router.example", "localhost")
        .replace("7447", str(port))
    )


@pytest.fixture
def secured(folder: Path) -> Iterator[int]:
    """Port of a router with these rules."""
    port = free_port()
    config = zenoh.Config.from_json5(example("zenoh-router.json5", folder, port, ""))
    with contextlib.closing(zenoh.open(config)):
        yield port


@pytest.fixture
def arm(fake_daemon: Any, folder: Path, secured: int, tmp_path: Path) -> Iterator[Bridge]:
    """`contactd-zenoh --allow-arm --config`."""
    file = tmp_path / "zenoh.json5"
    file.write_text(example("zenoh-arm.json5", folder, secured, "arm"))
    bridge = Bridge(fake_daemon.path, "", arming=True, configuration=file)
    bridge.joined()
    yield bridge
    bridge.close()


@pytest.fixture
def session(folder: Path, secured: int) -> Iterator[Callable[[str], zenoh.Session]]:
    """Session by name, which must be let in."""
    with contextlib.ExitStack() as opened:

        def open_as(who: str) -> zenoh.Session:
            text = example("zenoh-arm.json5", folder, secured, who)
            config = zenoh.Config.from_json5(text.replace("timeout_ms: -1", "timeout_ms: 20000"))
            return opened.enter_context(contextlib.closing(zenoh.open(config)))

        yield open_as


def call(session: zenoh.Session, name: str) -> bool:
    """True if a service answers."""
    kind, payload = (SET_BOOL, b"\0\1\0\0\1") if name == "arm" else (TRIGGER, b"\0\1\0\0\0")
    key = NODE.key(endpoint(NODE, name, kind))
    about = attachment(1, time.time_ns(), gid_of(str(session.zid())))
    replies = session.get(key, payload=payload, attachment=about, timeout=10.0)
    return any(reply.ok is not None for reply in replies)


def heard(session: zenoh.Session) -> list[str]:
    """Names of the topics on which anything comes, from now on."""
    got: list[str] = []
    for key in ("0/left_arm/**", "0/diagnostics/**"):
        session.declare_subscriber(key, lambda sample: got.append(str(sample.key_expr)))
    return got


@pytest.mark.parametrize(
    ("who", "may"), [("planner", {"stop", "disarm", "arm"}), ("screen", {"stop", "disarm"})]
)
def test_each_certificate_has_its_own_permissions(
    arm: Bridge, session: Callable[[str], zenoh.Session], who: str, may: set[str], fake_daemon: Any
) -> None:
    mine = session(who)
    until(lambda: all(call(mine, name) for name in may))  # they have reached the router
    assert {name for name in ("stop", "disarm", "arm", "reset") if call(mine, name)} == may
    if "arm" in may:  # which takes more than one call
        until(lambda: call(mine, "arm") and "arm" in [command for command, _ in fake_daemon.seen])
    assert ("arm" in [command for command, _ in fake_daemon.seen]) == ("arm" in may)
    got = heard(mine)
    until(lambda: {key.split("/")[2] for key in got} >= {"joint_states", "external_torque"})
    until(lambda: any(key.startswith("0/diagnostics/") for key in got))
    described: list[Any] = []
    description = Endpoint(
        Kind.PUBLISHER, NODE.absolute("robot_description"), "std_msgs/msg/String", Qos.LATCHED
    )
    ext.declare_advanced_subscriber(
        mine,
        NODE.key(description),
        described.append,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
    )
    until(lambda: described)


def test_a_subscriber_cannot_publish_for_the_arm(
    arm: Bridge, session: Callable[[str], zenoh.Session]
) -> None:
    screen, planner = session("screen"), session("planner")
    until(lambda: call(planner, "stop"))
    forged: list[bytes] = []
    planner.declare_subscriber(
        "0/left_arm/contact/**", lambda sample: forged.append(sample.payload.to_bytes())
    )
    got = heard(planner)
    key = NODE.key(endpoint(NODE, "arm", SET_BOOL))
    screen.declare_queryable(key, lambda query: query.reply(query.key_expr, b"forged"))
    for _ in range(20):
        screen.put("0/left_arm/contact/x/y", b"forged")
    (reply,) = planner.get(key, payload=b"none", timeout=10.0)
    assert reply.err is not None  # the arm's own
    known = len(got)
    until(lambda: len(got) > known + 100)
    assert forged == []


def test_an_unlisted_certificate_gets_nothing_and_does_nothing(
    arm: Bridge, session: Callable[[str], zenoh.Session], fake_daemon: Any
) -> None:
    visitor, screen = session("visitor"), session("screen")
    until(lambda: call(screen, "stop"))
    asked = len([command for command, _ in fake_daemon.seen if command == "stop"])
    got, others = heard(visitor), heard(screen)
    assert not any(call(visitor, name) for name in ("stop", "disarm", "arm"))
    assert list(visitor.liveliness().get("@ros2_lv/**", timeout=10.0)) == []
    until(lambda: len(others) > 100)
    assert got == []
    assert len([command for command, _ in fake_daemon.seen if command == "stop"]) == asked


@pytest.mark.parametrize("how", ["no certificate", "another CA", "no TLS"])
def test_an_unknown_client_is_refused(folder: Path, secured: int, how: str) -> None:
    text = example("zenoh-arm.json5", folder, secured, "planner")
    text = text.replace("timeout_ms: -1, exit_on_failure: false", "timeout_ms: 3000")
    lines = text.splitlines()
    if how == "no certificate":
        text = "\n".join(line for line in lines if "connect_" not in line and "mtls" not in line)
    if how == "another CA":
        text = text.replace(f"{folder}/planner", f"{folder}/elsewhere/planner")
    if how == "no TLS":
        text = text.replace("tls/localhost", "tcp/localhost")
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(text)).close()


KEYS = [
    ("screen.key", "planner.key", "are not a certificate and its key: KEY_VALUES_MISMATCH"),
    ("screen.key", "ca.pem", "are not a certificate and its key: "),
    ("screen.key", "missing.key", "missing.key: No such file or directory"),
    ("ca.pem", "missing.pem", "root_ca_certificate: "),
]


@pytest.mark.parametrize(("right", "wrong", "words"), KEYS)
def test_wrong_key_files_are_named(
    folder: Path, tmp_path: Path, right: str, wrong: str, words: str
) -> None:
    text = example("zenoh-arm.json5", folder, 1, "screen")
    file = tmp_path / "wrong.json5"
    file.write_text(text.replace(f"/{right}", f"/{wrong}"))
    done = CliRunner().invoke(contactd.main, ["fleet", "--config", str(file), "--stop", "--all"])
    assert done.exit_code == 78
    assert f"contactd: {file}: " in done.output
    assert f"{folder}/{wrong}" in done.output
    assert words in done.output


def test_a_fleet_waits_for_no_router(folder: Path, tmp_path: Path, port: int) -> None:
    """An arm configured as in the example waits for ever, a fleet command does not."""
    file = tmp_path / "screen.json5"
    file.write_text(example("zenoh-arm.json5", folder, port, "screen"))
    command = [sys.executable, "-m", "programs.contactd.contactd", "fleet", "--config", str(file)]
    done = subprocess.run(
        [*command, "--stop", "--all"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 69
    assert done.stderr.startswith(f"contactd: no router at {file}: Unable to connect to any of ")
    assert ".rs" not in done.stderr
