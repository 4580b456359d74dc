"""Bench of a fleet: replayed arms in a graph, and what is reported of them."""

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest

from bench.fleet import ages_ms, record, report
from bench.rigs.bridge import until
from bench.rigs.replayed_arms import Played, arms_of, played
from bench.rigs.zenoh_router import free_port, session_at
from daemon.ros.names import Distro
from daemon.ros.supervisor import Supervisor


def test_replayed_arms_are_arms(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    record(tmp_path / "states")
    with (
        contextlib.closing(session_at(endpoint, "router")),
        arms_of(endpoint, 3, 2, tmp_path / "states") as process,
        contextlib.closing(session_at(endpoint, "client")) as session,
        Supervisor(session, 0, Distro.JAZZY) as supervisor,
    ):
        until(lambda: [arm.mode for arm in supervisor.arms()] == ["off", "off"])
        names = [arm.name for arm in supervisor.arms()]
        took = played(process)
    assert names == ["arm_3", "arm_4"]
    assert took.arms == 2
    assert took.cpu_s > 0.0


def test_ages_are_between_stamp_and_arrival() -> None:
    assert ages_ms([(5, 500_000_000, 5.502)]) == pytest.approx([2.0])


@pytest.mark.parametrize(("stand", "status"), [(2, 0), (1, 1), (0, 1)])
def test_an_arm_that_does_not_stand_is_a_target_missed(
    stand: int, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    stopped: dict[str, Any] = {
        f"arm_{i}": ("stands" if i < stand else "no answer", "") for i in range(2)
    }
    took = [Played(2, 0.1, 10.0, 0.02, 60.0)]
    with pytest.raises(SystemExit) as ended:
        report(2, took, [1.0, 2.0], (0.1, 0.2, 0.3), stopped, 0.5, as_json=True)
    assert ended.value.code == status
    said = json.loads(capsys.readouterr().out)
    assert said["data"]["cpu_per_arm_percent"] == pytest.approx(0.5)
    assert said["targets"][0]["met"] is (status == 0)
