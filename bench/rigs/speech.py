"""Speech of a make on the bus: which frames are whose, what they say, and how its drives fail."""

from collections.abc import Sequence
from typing import Any, Protocol

from bench.rigs import foreign_tool
from drivers.can.wire import Frame
from drivers.canopen.cia402 import QUICK_STOP
from drivers.canopen.codec import receive_pdos, transmit_pdos
from drivers.canopen.ids import EMERGENCY, ENTER_PRE_OPERATIONAL, NMT, SYNC
from drivers.damiao.frames import ANSWERS, DISABLE, REGISTERS, Status, read, refresh, setpoint_of
from drivers.robstride import frames as robstride
from simulator.arm import SimulatedArm
from simulator.damiao.models import ENCODER_COUNTS
from simulator.damiao.motor import LOST, OVERLOAD, ROTOR_HOT, UNDER_VOLTAGE
from simulator.damiao.registers import MODE, VELOCITY
from simulator.motor import Command
from simulator.profile import TURN

#: Errors by their codes in CANopen.
OVER_CURRENT, SUPPLY, HOT, MASTER_SILENT = 0x2310, 0x3220, 0x4310, 0x8130
_ERRORS = {SUPPLY: UNDER_VOLTAGE, HOT: ROTOR_HOT, MASTER_SILENT: LOST}
_FAULTS = {SUPPLY: robstride.Fault.UNDERVOLTAGE, HOT: robstride.Fault.OVERHEATED}
_NO_VELOCITY = 0x7FF


class Speech(Protocol):
    """Speech of one make. `drive` is one of the daemon's."""

    operating: str
    """State of a simulated drive that follows its setpoints."""
    stopped: str
    """State of one that was commanded to stop."""
    request: int
    """Identifier of what asks for samples."""
    stops_by_ramp: bool
    """True where to stop is a ramp of setpoints."""

    def kin(self, can_id: int) -> int:
        """Identifier that stands for all that differ only by what their sender reports."""

    def answers(self, drive: Any) -> list[int]:
        """Identifiers of a drive's samples."""

    def link_scale(self, drive: Any) -> float:
        """A count of its link encoder [rad]."""

    def foreign(self, drive: Any) -> tuple[Frame, Frame, Frame]:
        """Another master's request, command without power and setpoint to the drive."""

    def setpoints(self, drives: Sequence[Any], sent: Sequence[Frame]) -> dict[int, tuple[int, int]]:
        """Whether a drive is to follow (0 if not), and its velocity in counts, by node."""

    def simulated(self, arm: SimulatedArm, joint: int) -> Any:
        """The drive at the other end of the bus."""

    def states(self, arm: SimulatedArm) -> set[str]:
        """States of all of them."""

    def runs(self, drive: Any) -> bool:
        """True for a simulated drive with torque."""

    def answer_kind(self, data: bytes) -> int:
        """Kind of this answer among those that share an identifier."""

    def deaf(self, to: str) -> tuple[str, ...]:
        """Methods of a simulated drive by which it hears `setpoints`, `set-up`, `all but
        silence`, `requests` or `all`."""

    def emergency(self, on: Any, code: int) -> None:
        """Have the disturbed drive report an error, by its code in CANopen; 0 is none."""

    def fail(self, on: Any) -> None:
        """Have it fail for real, by over-current."""

    def lock(self, on: Any) -> None:
        """Have it miss its master, and take no setpoint until a reset."""

    def ignore_setpoints(self, on: Any) -> None:
        """Have another tool turn its setpoints off."""


class Canopen:
    """CANopen: TPDOs after a SYNC, controlwords, emergency messages."""

    operating, stopped, stops_by_ramp = "OPERATION_ENABLED", "QUICK_STOP_ACTIVE", False
    request = SYNC

    def kin(self, can_id: int) -> int:
        """Itself."""
        return can_id

    def answers(self, drive: Any) -> list[int]:
        """Its TPDOs."""
        return [pdo.cob_id for pdo in transmit_pdos(drive)]

    def link_scale(self, drive: Any) -> float:
        """As configured."""
        return float(drive.profile.link_position.scale)

    def foreign(self, drive: Any) -> tuple[Frame, Frame, Frame]:
        """SYNC, NMT, its first RPDO."""
        pdo = receive_pdos(drive)[0]
        command = NMT, bytes([ENTER_PRE_OPERATIONAL, drive.node])
        return (SYNC, b""), command, (pdo.cob_id, bytes(pdo.layout.size))

    def answer_kind(self, data: bytes) -> int:
        """Each has its own."""
        return 0

    def deaf(self, to: str) -> tuple[str, ...]:
        """PDOs, SDO, NMT, SYNC, heartbeats."""
        return {
            "setpoints": ("on_pdo",),
            "set-up": ("on_pdo", "on_sdo"),
            "all but silence": ("on_pdo", "on_sdo", "on_nmt"),
            "requests": ("latch", "transmit"),
            "all": ("on_pdo", "on_sdo", "on_nmt", "on_heartbeat", "transmit", "latch"),
        }[to]

    def setpoints(self, drives: Sequence[Any], sent: Sequence[Frame]) -> dict[int, tuple[int, int]]:
        """Setpoints in the RPDOs."""
        frames, found = dict(sent), {}
        for drive in drives:
            sent_to_it: dict[str, int] = {}
            for pdo in receive_pdos(drive):
                if pdo.cob_id in frames:
                    counts = pdo.layout.unpack(frames[pdo.cob_id])
                    sent_to_it |= zip((field.entry for field in pdo.fields), counts, strict=True)
            if sent_to_it:
                follows = sent_to_it["controlword"] & 0x0F not in (0, QUICK_STOP)
                found[drive.node] = int(follows), sent_to_it["target_velocity"]
        return found

    def simulated(self, arm: SimulatedArm, joint: int) -> Any:
        """Drive of a joint."""
        return arm.drives[joint]

    def states(self, arm: SimulatedArm) -> set[str]:
        """By CiA 402."""
        return {drive.state.name for drive in arm.drives}

    def runs(self, drive: Any) -> bool:
        """In operation."""
        return bool(drive.state.name == self.operating)

    def emergency(self, on: Any, code: int) -> None:
        """An emergency message; the drive is as before."""
        on.say(EMERGENCY + on.drive.node, code.to_bytes(2, "little") + bytes([code > 0] + [0] * 5))

    def fail(self, on: Any) -> None:
        """The drive fails."""
        on.simulated.fault(OVER_CURRENT, "over-current")

    def lock(self, on: Any) -> None:
        """It takes no fault reset."""
        on.simulated.lock()

    def ignore_setpoints(self, on: Any) -> None:
        """Its RPDO is turned off."""
        on.simulated.on_sdo(foreign_tool.rpdo_off(on.drive))


class Damiao:
    """Damiao motors: a feedback for each frame, a status in it; to stop is a ramp of setpoints."""

    operating, stopped, stops_by_ramp = "ENABLED", "ENABLED", True
    request = REGISTERS

    def kin(self, can_id: int) -> int:
        """Itself."""
        return can_id

    def answers(self, drive: Any) -> list[int]:
        """Its master id."""
        return [drive.node + ANSWERS]

    def link_scale(self, drive: Any) -> float:
        """Scale of the sensor in the motor."""
        return float(drive.wiring.link_sign * TURN / ENCODER_COUNTS)

    def foreign(self, drive: Any) -> tuple[Frame, Frame, Frame]:
        """The setpoint is zeros: full torque backwards."""
        return refresh(drive.node), (drive.node, DISABLE), (drive.node, bytes(8))

    def answer_kind(self, data: bytes) -> int:
        """The register, or 0 for a feedback."""
        return data[3] if data[2] == read(0, 0)[1][2] else 0

    def deaf(self, to: str) -> tuple[str, ...]:
        """Without setpoints it lets go, and says so."""
        return {"requests": ("_on_register",), "all": ("on_frame",)}[to]

    def setpoints(self, drives: Sequence[Any], sent: Sequence[Frame]) -> dict[int, tuple[int, int]]:
        """They always follow; one without velocity counts as commanded to stop."""
        nodes, found = {drive.node for drive in drives}, {}
        for can_id, data in sent:
            if can_id in nodes and (sent_to_it := setpoint_of(data)):
                counts = sent_to_it[1] - _NO_VELOCITY
                counts -= counts == 1  # zero lies between two
                found[can_id] = int(counts != 0), counts
        return found

    def simulated(self, arm: SimulatedArm, joint: int) -> Any:
        """Motor of a joint."""
        return arm.motors[joint]

    def states(self, arm: SimulatedArm) -> set[str]:
        """As in their feedback."""
        return {Status(motor.status).name for motor in arm.motors}

    def runs(self, drive: Any) -> bool:
        """Enabled."""
        return bool(drive.status == Status.ENABLED)

    def emergency(self, on: Any, code: int) -> None:
        """The motor fails: it has no message beside its status."""
        if code:
            on.simulated.fail(_ERRORS[code])

    def fail(self, on: Any) -> None:
        """The motor fails."""
        on.simulated.fail(OVERLOAD)

    def lock(self, on: Any) -> None:
        """It lets go."""
        on.simulated.fail(LOST)

    def ignore_setpoints(self, on: Any) -> None:
        """It is put into its velocity mode."""
        on.simulated.registers.values[MODE] = VELOCITY
        on.simulated.command = Command()
        on.simulated._act()


class RobStride:
    """RobStride motors: a feedback for each frame, mode and faults in its identifier."""

    operating, stopped, stops_by_ramp = "RUN", "RUN", True
    request = robstride.identifier(robstride.Kind.SETPOINT, 0, 0)

    def kin(self, can_id: int) -> int:
        """A feedback without mode and faults, and a request or setpoint to any motor."""
        kind = robstride.kind_of(can_id)
        if kind in (robstride.Kind.WRITE, robstride.Kind.SETPOINT):
            return self.request
        return can_id & ~(0xFF << 16) if kind == robstride.Kind.FEEDBACK else can_id

    def answers(self, drive: Any) -> list[int]:
        """Its feedback to us."""
        return [robstride.identifier(robstride.Kind.FEEDBACK, drive.node, robstride.HOST)]

    def link_scale(self, drive: Any) -> float:
        """It has no encoder there."""
        raise NotImplementedError

    def foreign(self, drive: Any) -> tuple[Frame, Frame, Frame]:
        """From another address."""
        request = robstride.write(drive.node, robstride.Parameter.TIMEOUT, 2000)
        setpoint = robstride.setpoint_id(drive.node), bytes(8)
        return request, robstride.stop(drive.node), setpoint

    def answer_kind(self, data: bytes) -> int:
        """They are one."""
        return 0

    def setpoints(self, drives: Sequence[Any], sent: Sequence[Frame]) -> dict[int, tuple[int, int]]:
        """They always follow; one without velocity counts as commanded to stop."""
        found = {}
        for can_id, data in sent:
            if robstride.kind_of(can_id) == robstride.Kind.SETPOINT:
                counts = robstride.fields_of(data)[1] - 0x7FFF
                counts -= counts == 1  # zero lies between two
                found[can_id & 0xFF] = int(counts != 0), counts
        return found

    def simulated(self, arm: SimulatedArm, joint: int) -> Any:
        """Motor of a joint."""
        return arm.motors[joint]

    def states(self, arm: SimulatedArm) -> set[str]:
        """As in their feedback."""
        return {self.operating if self.runs(motor) else "RESET" for motor in arm.motors}

    def runs(self, drive: Any) -> bool:
        """By its mode."""
        return bool(drive.mode == robstride.RUN)

    def deaf(self, to: str) -> tuple[str, ...]:
        """Without setpoints it lets go."""
        return {"all": ("on_frame",)}[to]

    def emergency(self, on: Any, code: int) -> None:
        """The motor fails."""
        if code:
            on.simulated.fail(_FAULTS[code])

    def fail(self, on: Any) -> None:
        """The motor fails."""
        on.simulated.fail(robstride.Fault.OVERLOAD)

    def lock(self, on: Any) -> None:
        """It reports nothing of the kind."""
        raise NotImplementedError

    def ignore_setpoints(self, on: Any) -> None:
        """It is put into its velocity mode."""
        on.simulated.parameters[robstride.Parameter.MODE] = 2
        on.simulated._act()


CANOPEN, DAMIAO_BUS, ROBSTRIDE_BUS = Canopen(), Damiao(), RobStride()
