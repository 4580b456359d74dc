"""A router, another user's session there, and bridges to it."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk.session import ZenohSession

from tests.programs.zenoh.bridge import Bridge
from tests.programs.zenoh.zenoh_router import free_port, session_at


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def routed(port: int) -> Iterator[int]:
    """Port of a router in this process."""
    with contextlib.closing(session_at(f"tcp/127.0.0.1:{port}", "router")):
        yield port


@pytest.fixture
def other(routed: int) -> Iterator[zenoh.Session]:
    """A session of another user."""
    with contextlib.closing(session_at(f"tcp/127.0.0.1:{routed}", "client")) as opened:
        yield opened


@pytest.fixture
def diagnostics(other: zenoh.Session) -> list[Any]:
    """Messages on /diagnostics, as rosbags reads it."""
    store, got = get_typestore(Stores.ROS2_JAZZY), list[Any]()

    def take(sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        got.append(store.deserialize_cdr(payload, "diagnostic_msgs/msg/DiagnosticArray"))

    other.declare_subscriber("0/diagnostics/**", take)
    return got


@pytest.fixture
def start() -> Iterator[Callable[..., Bridge]]:
    """Starts the bridge of a daemon, to the router at a port."""
    started: list[Bridge] = []

    def begin(control: Path, port: int, name: str = "left_arm", *, arming: bool = False) -> Bridge:
        started.append(Bridge(control, f"tcp/127.0.0.1:{port}", name, arming=arming))
        return started[-1]

    yield begin
    for bridge in started:
        bridge.close()


@pytest.fixture
def sdk(routed: int) -> Iterator[int]:
    """Port of a router to which zenoh-ros2-sdk is connected."""
    opened = ZenohSession.get_instance("127.0.0.1", routed)
    yield routed
    opened.session.close()
    ZenohSession._instance = None
