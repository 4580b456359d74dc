"""Made-up messages, a daemon that is only a polled ControlSocket, and a whole one in lockstep."""

import math
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner, Result

from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.modes.contact_reactions import ContactReaction, Reactions
from daemon.modes.table import Mode
from daemon.protocol.replies import Check, Grant, Reply, Status, Trajectory
from daemon.protocol.requests import Request
from daemon.protocol.socket_path import Peer
from daemon.protocol.state import STATE_FORMAT, Contact, Notice, Snapshot, State, Timing
from daemon.service.socket import ControlSocket
from programs.clients.client import Client
from programs.contactctl import contactctl, replies
from tests.ideal_arm import LIMITS, IdealArm, T, tracking_arm

MakeArm = Callable[..., IdealArm]

JOINTS = [f"L{part}" for part in ("ShoulderPitch", "ShoulderYaw", "ElbowRoll", "ElbowYaw")]
JOINTS += ["LWristRoll", "LWristYaw", "LWristPitch"]
HALF_GAP = [0.018, 0.025, 0.003, 0.011, 0.0, 0.0, 0.023]
THRESHOLDS = [0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2]


def state_at(tick: int, **changes: object) -> State:
    """Seven joints swaying, in contact at joint 2 from tick 100 to 199."""
    n = len(JOINTS)
    t = 0.01 * tick
    phi = [1.1 * a * math.sin(t + i) for i, a in enumerate(HALF_GAP)]
    residual = [0.3 * h * math.sin(3 * t + i) for i, h in enumerate(THRESHOLDS)]
    touched = 100 <= tick < 200
    if touched:
        residual[1] = -1.3
    excess = [
        math.copysign(max(abs(r) - h, 0.0), r) for r, h in zip(residual, THRESHOLDS, strict=True)
    ]
    contact = Contact(joint=JOINTS[1], torque=-1.3, threshold=0.5, level="contact", side="left")
    state = State(
        tick=tick,
        time_s=t,
        interval_s=0.01,
        mode="admittance" if touched else "tracking",
        armed=True,
        cause="contact at LShoulderYaw" if touched else "start",
        moving=True,
        fresh=[True] * n,
        sensing=[True] * n,
        sensing_since_s=[0.03] * n,
        drives=["operation enabled"] * n,
        current=[0.1 * math.sin(t + i) for i in range(n)],
        link_position=[0.5 * math.sin(t + i) for i in range(n)],
        motor_velocity=[0.5 * math.cos(t + i) for i in range(n)],
        motor_position=None,
        link_velocity=[0.5 * math.cos(t + i) for i in range(n)],
        motor_estimate=[0.5 * math.sin(t + i) for i in range(n)],
        phi=phi,
        phi_sigma=[0.001] * n,
        side=[
            "gap" if abs(p) < 0.9 * a else "left" if p < 0 else "right"
            for p, a in zip(phi, HALF_GAP, strict=True)
        ],
        motor_torque=[0.3 * math.sin(t + i) for i in range(n)],
        residual=residual,
        threshold=THRESHOLDS,
        thresholded=excess,
        level_share=[1.0] * n,
        touched_link="",
        beside={"classical": [3.0 * r for r in residual]},
        flags=[],
        reference=[0.5 * math.sin(t + i) for i in range(n)],
        setpoint=[0.0] * n,
        quiet_s=0.0 if touched else t,
        notices=[Notice(kind="contact", text="contact at LShoulderYaw", contact=contact)]
        if tick == 100
        else [],
        timing=Timing(
            wall_s=1.8e9 + t, monotonic_s=500.0 + t, lateness_us=90.0, work_us=2100.0, missed=0
        ),
    )
    return msgspec.structs.replace(state, **changes)


def snapshot_at(tick: int) -> Snapshot:
    """The snapshot that goes with `state_at`."""
    return Snapshot(
        format=STATE_FORMAT,
        joints=JOINTS,
        half_gap=HALF_GAP,
        thresholds=THRESHOLDS,
        period_s=0.01,
        tick=tick,
        memory={"tick": tick},
        configuration="version: 1\n",
        urdf="<robot/>",
        program="contactd 0.1.0",
        wrench_axes="l_wrist",
        wrench_point=[0.07, 0.0, 0.0],
        quiet_s=2.0,
    )


@dataclass
class FakeDaemon:
    """Polls a ControlSocket every millisecond; `modes` is what each command leads to, in order."""

    path: Path
    modes: dict[str, list[str]] = field(default_factory=dict)
    refusals: dict[str, list[str]] = field(default_factory=dict)
    states: Callable[[int], State | None] = state_at  # None: publishes nothing in that tick
    snapshot_ahead: int = 0  # ticks between the last State and what a snapshot says
    mode: str = "off"
    unproved: list[str] = field(default_factory=list)
    proves_after: int = 0  # times that the status is asked for, if there are unproved joints
    silenced: bool = False
    trajectory: Any = "ready"
    urdf: str = "<robot/>"
    walls: dict[str, Any] | None = None
    tick: int = 0
    seen: list[tuple[str, Peer]] = field(default_factory=list)
    ready: threading.Event = field(default_factory=threading.Event)
    stopped: threading.Event = field(default_factory=threading.Event)
    _ahead: list[str] = field(default_factory=list)

    def handle(self, request: Request, peer: Peer) -> Reply:
        command = request.command
        self.seen.append((command, peer))
        if reasons := self.refusals.get(command):
            return Reply(ok=False, message=f"{command} is refused", reasons=reasons, mode=self.mode)
        if command == "subscribe":
            snapshot = snapshot_at(self.tick + self.snapshot_ahead)
            ours = msgspec.structs.replace(snapshot, urdf=self.urdf, walls=self.walls)
            return Reply(ok=True, snapshot=ours)
        if command == "status":
            if self._ahead:
                self.mode = self._ahead.pop(0)
            self.proves_after -= 1
            if self.proves_after == 0:
                self.unproved = []
            return Reply(ok=True, status=self.status(), mode=self.mode)
        self._ahead = list(self.modes.get(command, []))
        return Reply(
            ok=True, message=f"{command} done", mode=self.mode, unproved=list(self.unproved)
        )

    def status(self) -> Status:
        state = state_at(self.tick)
        return Status(
            name="Romeo left arm",
            configuration="/etc/contactd/config.yaml",
            pid=4711,
            uptime_s=3725.0,
            mode=self.mode,
            armed=False,
            cause=f"because of {self.mode}",
            trajectory=Trajectory(
                name="sinusoids", state=self.trajectory, time_s=0.0, duration_s=None
            ),
            checks=[
                Check(name="mode", passed=False, text="the drives are off"),
                Check(name="samples", passed=True, text="all fresh in this tick"),
                Check(name="residual", passed=False, text="LWristYaw feels +0.30 Nm"),
            ],
            permit=None,
            ticks=372500,
            missed=3,
            lateness_max_us=412.0,
            work_max_us=3120.0,
            realtime=[
                Grant("priority", True, "real-time priority 40 (FIFO)"),
                Grant("memory", False, "memory not locked (Cannot allocate memory)"),
            ],
            readers=0,
            joints=JOINTS,
            drives=state.drives,
            link_position=state.link_position,
            residual=state.residual,
            threshold=state.threshold,
            side=state.side,
            gain=[0.1 * (i + 1) for i in range(len(JOINTS))],
            age_ticks=[0] * len(JOINTS),
            unproved=list(self.unproved),
            silenced=self.silenced,
        )

    def run(self) -> None:
        with ControlSocket(self.path) as control:
            self.ready.set()
            while not self.stopped.wait(0.001):
                control.poll(self.handle)
                self.tick += 1
                if (state := self.states(self.tick)) is not None:
                    control.publish(state)


@contextmanager
def running(daemon: FakeDaemon) -> Iterator[FakeDaemon]:
    thread = threading.Thread(target=daemon.run)
    thread.start()
    assert daemon.ready.wait(5)
    yield daemon
    daemon.stopped.set()
    thread.join()


@pytest.fixture
def fake_daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    """A FakeDaemon that runs in a thread of its own until the test ends."""
    with running(FakeDaemon(tmp_path / "control")) as daemon:
        yield daemon


@pytest.fixture
def run(fake_daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Runs contactctl against the fake daemon; 0.3 s are long enough to wait."""
    monkeypatch.setattr(replies, "WAIT_S", 0.3)

    def call(*arguments: str) -> Result:
        return CliRunner().invoke(
            contactctl.main, ["--socket", str(fake_daemon.path), *arguments], catch_exceptions=False
        )

    return call


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedDaemon]:
    with served_daemon(tmp_path) as opened:
        yield opened


@pytest.fixture
def client(served: ServedDaemon) -> Iterator[Client]:
    with Client(served.path) as connected:
        yield connected


@pytest.fixture
def make_state() -> Callable[..., State]:
    """`state_at`, for tests that cannot import from here."""
    return state_at


@pytest.fixture
def make_snapshot() -> Callable[[int], Snapshot]:
    """`snapshot_at`, for tests that cannot import from here."""
    return snapshot_at


@pytest.fixture
def control(tmp_path: Path) -> Iterator[ControlSocket]:
    with ControlSocket(tmp_path / "control") as opened:
        yield opened


@pytest.fixture
def dial(control: ControlSocket) -> Iterator[Callable[[], socket.socket]]:
    """Connects without blocking; everything is closed at the end."""
    opened: list[socket.socket] = []

    def connect() -> socket.socket:
        opened.append(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK))
        opened[-1].connect(str(control.path))
        return opened[-1]

    yield connect
    for one in opened:
        one.close()


@pytest.fixture
def tracking() -> Iterator[MakeArm]:
    """Makes tracking arms; whatever happens, their setpoints never jump."""
    made: list[IdealArm] = []

    def make(
        contact: ContactReaction = ContactReaction.ADMITTANCE,
        collision: ContactReaction = ContactReaction.ADMITTANCE,
        **more,
    ):
        made.append(tracking_arm(reactions=Reactions(contact, collision), **more))
        return made[-1]

    yield make
    for arm in made:
        velocity = np.array([decision.velocity for decision in arm.decisions])
        step = np.abs(np.diff(velocity, axis=0))
        assert arm.mode is Mode.FAULTED or (step <= LIMITS.acceleration * T + 1e-12).all()
