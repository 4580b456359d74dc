"""Line to the process that gathers trends: its death ends nothing, in whichever tick it shows."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from bench.rigs.lockstep import SINGLE_JOINT, lockstep_rig
from daemon.service.trend_line import LISTENS_EVERY, TrendLine


@pytest.mark.parametrize("ticks", [LISTENS_EVERY - 2, LISTENS_EVERY - 1, LISTENS_EVERY])
def test_a_gatherer_that_ends_before_it_answers(tmp_path: Path, ticks: int) -> None:
    with lockstep_rig(SINGLE_JOINT) as rig, ExitStack() as cleanup:
        rig.enable()
        line = TrendLine(rig.robot, tmp_path)
        for _ in range(ticks):
            line.put(rig.last, rig.tick.estimator)
        process = line._process
        assert process is not None
        for end in (process.stdin, process.stdout):
            assert end is not None
            cleanup.callback(end.close)
        process.kill()
        process.wait()
        line.put(rig.last, rig.tick.estimator)
        assert line._process is None
