"""Zenoh router on this machine as a process, for tests and benches: a session in router mode.

python -m tests.programs.zenoh.zenoh_router PORT
"""

import contextlib
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import zenoh


@dataclass(frozen=True, slots=True)
class Router:
    """Running router, at tcp/127.0.0.1:`port`."""

    process: subprocess.Popen[str]
    port: int

    @property
    def endpoint(self) -> str:
        """Endpoint that it listens on."""
        return f"tcp/127.0.0.1:{self.port}"


def free_port() -> int:
    """A TCP port that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def router_of(port: int) -> Iterator[Router]:
    """A router while the context lasts."""
    command = [sys.executable, "-m", "tests.programs.zenoh.zenoh_router", str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise RuntimeError("the router does not start")
        try:
            yield Router(process, port)
        finally:
            process.kill()


def session_at(endpoint: str, mode: str) -> zenoh.Session:
    """A session that listens there as a router, or is a client of the router there."""
    config = zenoh.Config()
    config.insert_json5("mode", f'"{mode}"')
    side = "listen" if mode == "router" else "connect"
    config.insert_json5(f"{side}/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    config.insert_json5("transport/shared_memory/enabled", "false")
    return zenoh.open(config)


def main() -> None:
    """Route until a signal comes."""
    with session_at(f"tcp/127.0.0.1:{int(sys.argv[1])}", "router"):
        print("routes", flush=True)
        signal.sigwait({signal.SIGTERM, signal.SIGINT})


if __name__ == "__main__":
    main()
