"""`contactd guard` beside `contactd run`, in processes: it holds an arm whose daemon is killed, or
hangs, or is out of memory, and a daemon that comes back takes it over there."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from bench.rigs.lockstep import OPENARM
from programs.clients.client import Client
from tests.daemon.test_processes import Daemon, Simulator, contactd, gone_afterwards, run, simulated

MEMORY = Path("/sys/fs/cgroup/memory")
STILL = 0.01  # the way of each joint meanwhile [rad]
GREEDY = "import os, sys; sys.stdin.read(1); os.urandom(64 << 20)"


def out_of_memory(process: subprocess.Popen[str]) -> None:
    """Have the kernel kill it for its memory: a neighbour in its group, which is spared,
    asks for more than there is."""
    group = MEMORY / f"contactd-{process.pid}"
    try:
        group.mkdir()
    except OSError as error:
        pytest.skip(f"NOT TRIED: no memory group ({error.strerror})")
    with subprocess.Popen([sys.executable, "-c", GREEDY], stdin=subprocess.PIPE) as greedy:
        Path(f"/proc/{process.pid}/oom_score_adj").write_text("1000")
        for pid in (process.pid, greedy.pid):
            (group / "cgroup.procs").write_text(str(pid))
        used = int((group / "memory.usage_in_bytes").read_text())
        (group / "memory.limit_in_bytes").write_text(str(used + (8 << 20)))
        greedy.communicate(b"x")
    assert process.wait(10.0) == -signal.SIGKILL
    assert "oom_kill 0" not in (group / "memory.oom_control").read_text()
    group.rmdir()


def killed(process: subprocess.Popen[str]) -> None:
    process.kill()


def hangs(process: subprocess.Popen[str]) -> None:
    os.kill(process.pid, signal.SIGSTOP)


@pytest.fixture
def simulator(tmp_path: Path) -> Iterator[Simulator]:
    """An arm whose motors are patient, as this machine may be busy."""
    folder = Path(shutil.copytree(OPENARM, tmp_path / "openarm"))
    text = (folder / "config.yaml").read_text()
    changed = text.replace("{make: damiao", "{master_timeout_ms: 500, make: damiao")
    (folder / "config.yaml").write_text(changed)
    with simulated(folder) as simulator:
        yield simulator


def positions(daemon: Daemon) -> np.ndarray:
    with Client(daemon.door) as client:
        return np.array(client.ask_status().link_position)


@pytest.mark.parametrize("dies", [killed, hangs, out_of_memory])
def test_it_holds_the_arm_of_a_daemon_that(
    dies: Callable[[subprocess.Popen[str]], None], simulator: Simulator, tmp_path: Path
) -> None:
    guard = contactd("guard", simulator.robot, "--port", simulator.port, stderr=subprocess.PIPE)
    with gone_afterwards(guard), gone_afterwards(run(simulator, tmp_path / "door")) as process:
        daemon = Daemon(process, tmp_path / "door")
        daemon.becomes("off")
        assert daemon.ask("enable") == []
        daemon.becomes("holding")
        stood = positions(daemon)
        dies(process)
        assert guard.stderr is not None
        for line in guard.stderr:
            if "holding the arm" in line:
                break
        else:
            pytest.fail("the guardian ended")
        process.kill()
        process.wait()
        with gone_afterwards(run(simulator, tmp_path / "again")) as second:
            again = Daemon(second, tmp_path / "again")
            again.becomes("off")
            assert np.abs(positions(again) - stood).max() < STILL
    assert simulator.reported == []  # no motor let go
