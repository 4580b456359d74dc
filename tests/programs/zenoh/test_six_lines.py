"""The six lines for a ROS 2 user, as docs/ros.md has them, by zenoh-ros2-sdk, as no ROS 2 is here.

Added to them is only where the test's own router and daemon are.
"""

import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from contactd_client.paths import view_socket_path
from tests.programs.zenoh.bridge import caller, joint_state, until

ROOT = Path(__file__).parents[3]
PAGE = "docs/ros.md"


def lines(page: str) -> list[list[str]]:
    """Words of the lines that a page has for a ROS 2 user, from the router to the stop."""
    text = (ROOT / page).read_text()
    block = text[text.index("    ros2 run rmw_zenoh_cpp rmw_zenohd") :].split("\n\n")[0]
    return [shlex.split(line, comments=True) for line in block.splitlines()]


def line(page: str, *begins: str) -> list[str]:
    """Text that follows these words in the one line that begins with them."""
    (found,) = [words for words in lines(page) if words[: len(begins)] == list(begins)]
    return found[len(begins) :]


@pytest.fixture
def page(fake_daemon: Any, sdk: int) -> Iterator[str]:
    """A page, whose line for the arm is running."""
    command = [sys.executable, "-m", "programs.zenoh.contactd_zenoh"]
    command += line(PAGE, "contactd-zenoh")
    command += ["--connect", f"tcp/127.0.0.1:{sdk}"]
    command += ["--view-socket", str(view_socket_path(fake_daemon.path))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        until(lambda: "joined" in process.stdout.readline())
        yield PAGE
        process.terminate()


def listed(port: int, *words: str) -> str:
    """Answer of the command line of zenoh-ros2-sdk to the words behind `ros2`."""
    command = [str(Path(sys.executable).with_name("zenoh-ros2")), "--no-daemon"]
    command += ["--router", f"127.0.0.1:{port}", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def test_the_lines_are_six_and_in_this_order() -> None:
    begins = ["ros2 run", "contactd-zenoh --namespace", "export RMW_IMPLEMENTATION=rmw_zenoh_cpp"]
    begins += ["ros2 topic", "ros2 topic", "ros2 service"]
    assert [" ".join(words[:2]) for words in lines(PAGE)] == begins


def test_topic_list(page: str, sdk: int) -> None:
    words = line(PAGE, "ros2", "topic", "list")
    until(lambda: "/left_arm/external_torque" in listed(sdk, "topic", "list", *words))
    shown = until(lambda: listed(sdk, "topic", "list", *words))
    assert "/left_arm/external_torque [sensor_msgs/msg/JointState]" in shown


def test_topic_echo(page: str, sdk: int) -> None:
    (name,) = line(page, "ros2", "topic", "echo")
    message = joint_state(name, sdk)
    assert len(message.effort) == len(message.name) == 7


def test_service_call(page: str, sdk: int, fake_daemon: Any) -> None:
    name, kind = line(page, "ros2", "service", "call")
    client = caller(name, sdk, kind)
    reply = until(lambda: client.call(structure_needs_at_least_one_member=0))
    client.close()
    assert (reply.success, reply.message) == (True, "stands")
    assert "stop" in [command for command, _ in fake_daemon.seen]
