"""contactd-zenoh.service beside contactd.service: its sandbox, its one socket, and a router of this
machine that comes and goes."""

import contextlib
import pwd
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from programs.zenoh.arming import SET_BOOL
from programs.zenoh.messages import read_outcome
from programs.zenoh.names import Distro, Node, attachment
from programs.zenoh.services import TRIGGER, endpoint
from tests.programs.zenoh.zenoh_router import router_of, session_at
from tests.system.stand import Service, Simulator, assert_is_confined, run, show, wait_for

ROS = "contactd-zenoh.service"
PORT = 7447
NODE = Node(0, "/contactd", "contactd", Distro.JAZZY)
PAYLOADS = {TRIGGER: b"\0\1\0\0\0", SET_BOOL: b"\0\1\0\0\1"}


def call(name: str, kind: str = TRIGGER) -> tuple[bool, str] | None:
    """Answer of a service; None where there is no answer, or no router."""
    with (
        contextlib.suppress(zenoh.ZError),
        contextlib.closing(session_at(f"tcp/127.0.0.1:{PORT}", "client")) as session,
    ):
        about = attachment(1, time.time_ns(), b"a gid of 16 byte")
        key = NODE.key(endpoint(NODE, name, kind))
        for reply in session.get(key, payload=PAYLOADS[kind], attachment=about, timeout=60.0):
            if reply.ok is not None:
                return read_outcome(reply.ok.payload.to_bytes())
    return None


@pytest.fixture
def ros(service: Service, simulator: Simulator) -> Iterator[Service]:
    """The unit as it is installed, beside a daemon that is ready."""
    service.start()
    run("systemctl", "start", ROS, check=True)
    yield service
    run("systemctl", "stop", ROS)
    run("systemctl", "reset-failed", ROS)


def test_the_process_is_confined_to_the_view_socket(ros: Service) -> None:
    pid = int(show(ROS, "MainPID"))
    uid = pwd.getpwnam("contactd-zenoh").pw_uid
    wait_for(lambda: Path(f"/proc/{pid}").stat().st_uid == uid, "its own user")
    assert_is_confined(pid, "contactd-zenoh")


def test_external_torques_are_published_and_the_arm_is_stopped(ros: Service) -> None:
    ros.enable()
    assert ros.request("start").ok
    ros.wait_for_mode("tracking")
    with router_of(PORT), contextlib.closing(session_at(f"tcp/127.0.0.1:{PORT}", "client")) as own:
        got: list[Any] = []
        own.declare_subscriber("0/contactd/external_torque/**", got.append)
        wait_for(lambda: len(got) > 10, "external torques")
        assert call("arm", SET_BOOL) is None
        assert call("reset") is None
        done, said = wait_for(lambda: call("stop"), "an answer")
        # A slow machine has not seen it stand by then; that it was reached is what counts here.
        assert done or said.startswith("not seen to stand"), said
    status = ros.wait_for_mode("holding")
    assert f"stop by uid {pwd.getpwnam('contactd-zenoh').pw_uid} " in status.cause
    assert "on behalf of ROS 2 client" in status.cause


def test_the_service_outlasts_router_and_daemon(ros: Service) -> None:
    pid = show(ROS, "MainPID")
    for _ in range(2):
        with router_of(PORT):
            wait_for(lambda: call("stop"), "an answer at this router")
            ros.stop()
            done, said = wait_for(lambda: call("stop"), "an answer without a daemon")
            assert (done, said[:11]) == (False, "not reached")
            ros.start()
            wait_for(lambda: (call("stop") or (False,))[0], "the next daemon")
    assert (show(ROS, "MainPID"), show(ROS, "NRestarts")) == (pid, "0")


def test_a_wrong_option_is_not_tried_for_ever(ros: Service) -> None:
    drop_in = Path("/run/systemd/system/contactd-zenoh.service.d/system-test.conf")
    drop_in.parent.mkdir()
    command = show(ROS, "ExecStart").split("path=")[1].split(" ;")[0]
    try:
        drop_in.write_text(f"[Service]\nExecStart=\nExecStart={command} --allow-arm\n")
        run("systemctl", "daemon-reload", check=True)
        run("systemctl", "restart", ROS)
        wait_for(lambda: show(ROS, "ActiveState") == "failed", "the unit to fail")
        assert (show(ROS, "NRestarts"), show(ROS, "ExecMainStatus")) == ("0", "2")
    finally:
        drop_in.unlink()
        drop_in.parent.rmdir()
        run("systemctl", "daemon-reload", check=True)
