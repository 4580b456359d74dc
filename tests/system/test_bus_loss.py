"""Loss of can0: down, gone, full of errors; and back again."""

import socket
import struct
import time

from tests.system.stand import CAN, Service, Simulator, run, wait_for

LOST = "heartbeat of the master lost, quick stop"
ERROR_FRAME = 0x2000_0000
BUS_OFF = 0x40  # linux/can/error.h


def bring_down() -> None:
    run("ip", "link", "set", CAN, "down", check=True)


def bring_up() -> None:
    run("ip", "link", "set", CAN, "up", check=True)


def test_a_bus_that_goes_down_latches_a_fault_and_its_return_moves_nothing(
    can0: None, service: Service, simulator: Simulator
) -> None:
    service.start()
    service.enable()
    pid = service.pid
    bring_down()
    simulator.wait_for("drive", LOST)
    service.wait_for_mode("faulted")
    bring_up()
    status = service.status()
    assert (status.mode, service.pid) == ("faulted", pid)
    # A slow machine has had the drives stopped by NMT: they send nothing before they are reset.
    wait_for(lambda: service.request("reset").ok, "the reset")
    service.wait_for_mode("off")
    wait_for(lambda: "operation enabled" not in service.status().drives, "drives that are off")
    # The first reset may still meet errors that were queued in the drives.
    service.enable()


def test_without_can0_there_is_no_daemon_and_with_it_there_is_again(
    can0: None, service: Service, simulator: Simulator
) -> None:
    run("systemctl", "enable", "--runtime", "contactd.service", check=True)
    service.start()
    service.enable()
    pid = service.pid
    run("ip", "link", "delete", CAN, check=True)
    stopped = simulator.wait_for("drive", LOST)
    wait_for(lambda: service.show("ActiveState") in ("inactive", "failed"), "the end")
    run("ip", "link", "add", CAN, "type", "vcan", check=True)
    bring_up()
    wait_for(lambda: service.pid not in (0, pid), "a new process")
    service.wait_until_ready()
    assert stopped < service.started_s
    status = service.wait_for_samples()
    assert (status.mode, status.armed) == ("off", False)
    assert "operation enabled" not in status.drives


def test_bus_off_latches_a_fault(can0: None, service: Service, simulator: Simulator) -> None:
    service.start()
    service.enable()
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as controller:
        controller.bind((CAN,))
        frame = struct.pack("=IB3x8s", ERROR_FRAME | BUS_OFF, 8, bytes(8))

        def faulted() -> bool:
            for _ in range(40):
                controller.send(frame)
                time.sleep(0.02)
            return service.status().mode == "faulted"

        wait_for(faulted, "the fault")
    assert any("<3>[fault" in line and "bus off" in line for line in service.log())
