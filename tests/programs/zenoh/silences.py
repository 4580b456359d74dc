"""Ways in which a caller over Zenoh falls silent, between it and a daemon that it keeps armed."""

import contextlib
import signal
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.programs.web.network import Network, network
from tests.programs.zenoh.bridge import bridge_of
from tests.programs.zenoh.ros_caller import caller_of
from tests.programs.zenoh.zenoh_router import free_port, router_of

NAMESPACE: Final = "/left_arm"


@dataclass(frozen=True, slots=True)
class Way:
    """All that is between a caller and the daemon, each a process of its own, and the network
    between caller and router."""

    caller: subprocess.Popen[str]
    network: Network
    router: subprocess.Popen[str]
    bridge: subprocess.Popen[str]

    def go_on(self) -> None:
        """Let what was stopped go on: it finds what was kept for it."""
        for process in (self.caller, self.router, self.bridge):
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)


SILENCES: Final[dict[str, Callable[[Way], None]]] = {
    "the caller is killed": lambda way: way.caller.kill(),
    "the caller hangs": lambda way: way.caller.send_signal(signal.SIGSTOP),
    "the network is cut": lambda way: way.network.lose(),
    "the router is killed": lambda way: way.router.kill(),
    "the router hangs": lambda way: way.router.send_signal(signal.SIGSTOP),
    "the bridge is killed": lambda way: way.bridge.kill(),
    "the bridge ends": lambda way: way.bridge.terminate(),
    "the bridge hangs": lambda way: way.bridge.send_signal(signal.SIGSTOP),
}


@contextlib.contextmanager
def way_to(control: Path) -> Iterator[Way]:
    """A caller that has armed the daemon at this control socket, and keeps it armed."""
    with router_of(free_port()) as router, network(router.port) as between:
        options = ["--namespace", NAMESPACE, "--control-socket", str(control), "--allow-arm"]
        where = f"tcp/127.0.0.1:{between.port}"
        with (
            bridge_of(control, router.endpoint, *options) as bridge,
            caller_of(where, NAMESPACE) as caller,
        ):
            yield Way(caller, between, router.process, bridge)
