import numpy as np
from drivers.boot_up import boot_up
from drivers.cia402 import DriveState, PowerTarget


def test_enable(bench, setups, make_arm):
    with bench.lockstep.serving():
        boot_up(bench.bus, setups, period_ms=10, listen_s=0.01)
    arm = make_arm(bench.bus)
    arm.start(0.0)
    for k in range(20):
        s = bench.tick(arm)
        if k: print(k, s.states[0].name, s.fresh.all(), s.events, s.link_position[0], s.motor_velocity[0])
        arm.command(PowerTarget.ON, np.full(7, 0.1))
    print(arm.counters)
    assert all(state is DriveState.OPERATION_ENABLED for state in s.states)
