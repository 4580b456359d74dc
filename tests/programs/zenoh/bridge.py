"""The bridge to ROS 2 between any daemon's socket and a router: in a thread of this process, or as
one of its own."""

import contextlib
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk.service_client import ROS2ServiceClient
from zenoh_ros2_sdk.subscriber import ROS2Subscriber

from contactd_client.paths import view_socket_path
from programs.zenoh.names import Distro, Node
from programs.zenoh.serve import Settings, serve

LONGEST_S: Final = 60.0


def until(true: Callable[[], Any]) -> Any:
    """First value of `true` that is something. Raises TimeoutError where that never comes."""
    end_s = time.monotonic() + LONGEST_S
    while not (found := true()):
        if time.monotonic() > end_s:
            raise TimeoutError("it never came")
        time.sleep(0.005)
    return found


def joint_state(topic: str, port: int) -> Any:
    """First JointState of a topic, as zenoh-ros2-sdk at the router of this port reads it."""
    got, store, kind = list[Any](), get_typestore(Stores.ROS2_JAZZY), "sensor_msgs/msg/JointState"
    subscriber = ROS2Subscriber(
        topic=topic,
        msg_type=kind,
        callback=got.append,
        msg_definition=store.generate_msgdef(kind, ros_version=2)[0],
        type_hash=store.hash_rihs01(kind),
        router_ip="127.0.0.1",
        router_port=port,
    )
    message = until(lambda: got and got[0])
    subscriber.close()
    return message


def caller(
    name: str,
    port: int,
    kind: str,
    request: str = "uint8 structure_needs_at_least_one_member",
    type_hash: str | None = None,
) -> ROS2ServiceClient:
    """Client of a service, as zenoh-ros2-sdk at the router of this port has one."""
    return ROS2ServiceClient(
        service_name=name,
        srv_type=kind,
        request_definition=request,
        response_definition="bool success\nstring message",
        type_hash=type_hash,
        router_ip="127.0.0.1",
        router_port=port,
        timeout=LONGEST_S,
    )


class Bridge:
    """`contactd-zenoh` of the daemon at this control socket, which it may use only with `arming`;
    `said` is what it logs."""

    def __init__(
        self,
        control: Path,
        endpoint: str,
        name: str = "left_arm",
        *,
        arming: bool = False,
        following: bool = False,
        configuration: Path | None = None,
    ) -> None:
        self.said: list[str] = []
        self.node = Node(0, f"/{name}", "contactd", Distro.JAZZY)
        view, full = view_socket_path(control), control if arming or following else None
        settings = Settings(view, full, self.node, (endpoint,), configuration, arming, following)
        self._ended = threading.Event()
        self.thread = threading.Thread(target=serve, args=(settings, self.said.append, self._ended))
        self.thread.start()

    def heard(self, words: str) -> bool:
        """True if a line of its log contains the words."""
        return any(words in line for line in self.said)

    def joined(self) -> None:
        """Wait until it has joined the daemon."""
        until(lambda: self.heard("joined"))

    def close(self) -> None:
        """End it."""
        self._ended.set()
        self.thread.join()


@contextlib.contextmanager
def bridge_of(control: Path, endpoint: str, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`contactd-zenoh` of the daemon at this control socket as a process, which has joined it,
    while the context lasts."""
    command = [sys.executable, "-m", "programs.zenoh.contactd_zenoh", "--connect", endpoint]
    command += ["--view-socket", str(view_socket_path(control)), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            while "joined" not in (said := process.stdout.readline()):
                if not said:
                    raise RuntimeError("the bridge does not start")
            yield process
        finally:
            process.kill()
