"""A DM4340 that its maker has just built in."""

import pytest

from simulator.damiao.models import DamiaoMake
from tests.simulator.damiao.one_motor import MASTER_ID, One


@pytest.fixture
def one() -> One:
    return One(DamiaoMake("DM4340", MASTER_ID))
