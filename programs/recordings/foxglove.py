"""States as messages of Foxglove's schemas (extra `foxglove`), for a file or a live connection.

    /tf              foxglove.FrameTransforms   every link, from the joints' positions
    /scene           foxglove.SceneUpdate       capsules of the links; the touched one highlighted
    /touch           foxglove.SceneUpdate       the point of contact, a ball of its uncertainty
    /joint_states    foxglove.JointStates       position, velocity, external torque
    /joints/NAME     JSON, one field per value  for plots, in Foxglove and PlotJuggler
    /arm             JSON                       mode, armed, cause, touched link, loop
    /log             foxglove.Log               notices

The library's channels serve both uses.
"""

from typing import Any, Final

import msgspec
from foxglove import Channel, Context, Schema
from foxglove.channels import (
    FrameTransformsChannel,
    JointStatesChannel,
    LogChannel,
    SceneUpdateChannel,
)
from foxglove.messages import (
    Color,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    JointState,
    JointStates,
    Log,
    LogLevel,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    SpherePrimitive,
    Timestamp,
    Vector3,
)

from daemon.protocol.state import Snapshot, State, Wrench
from programs.recordings.skeleton import Capsule, Skeleton, skeleton_of, towards
from programs.recordings.touch_point import TouchFinder, TouchPoint

_GREY: Final = Color(r=0.62, g=0.66, b=0.70, a=1.0)
_LIT: Final = Color(r=0.84, g=0.37, b=0.0, a=1.0)
POINT: Final = "point of contact"
_TOUCH: Final = Color(r=0.84, g=0.37, b=0.0, a=0.35)
_LEVELS: Final = {"mode": LogLevel.Info, "contact": LogLevel.Warning, "fault": LogLevel.Error}


class JointValues(msgspec.Struct):
    """Measured and estimated values of one joint, in SI at the link side."""

    residual: float
    threshold: float
    thresholded: float
    link_position: float
    link_velocity: float
    motor_velocity: float
    motor_torque: float
    current: float
    phi: float
    phi_sigma: float
    reference: float
    setpoint: float
    side: str
    drive: str
    beside: dict[str, float]


#: Numeric fields, named like the vectors of a State.
_VECTORS: Final = [
    field.name for field in msgspec.structs.fields(JointValues) if field.type is float
]


class ArmValues(msgspec.Struct):
    """Values of the whole arm."""

    tick: int
    mode: str
    armed: bool
    cause: str
    touched_link: str
    quiet_s: float
    lateness_us: float
    work_us: float
    missed: int


def _schema(kind: type[msgspec.Struct], beside: list[str]) -> Schema:
    """JSON schema of one of the types above, with a field for each residual in `beside`."""
    (_,), parts = msgspec.json.schema_components([kind])
    schema: dict[str, Any] = {"type": "object", **parts[kind.__name__]}
    if "beside" in schema["properties"]:
        named = {name: {"type": "number"} for name in beside}
        schema["properties"]["beside"] = {"type": "object", "properties": named}
    return Schema(
        name=f"contactd.{kind.__name__}", encoding="jsonschema", data=msgspec.json.encode(schema)
    )


class FoxgloveChannels:
    """Channels of one arm in a context of the library."""

    def __init__(
        self, context: Context, snapshot: Snapshot, beside: list[str], draw_every: int = 1
    ) -> None:
        """Create the channels; draw_every: ticks per drawing of the arm."""
        self._joints = tuple(snapshot.joints)
        self._skeleton = skeleton_of(snapshot.urdf)
        self._column = {name: i for i, name in enumerate(self._joints)}
        self._link_of = self._skeleton.link_of()
        self._transforms = FrameTransformsChannel("/tf", context=context)
        self._scene = SceneUpdateChannel("/scene", context=context)
        self._touches = SceneUpdateChannel("/touch", context=context)
        self._states = JointStatesChannel("/joint_states", context=context)
        self._log = LogChannel("/log", context=context)
        json: dict[str, Any] = {"message_encoding": "json", "context": context}
        schema = _schema(JointValues, beside)
        self._values = [Channel(f"/joints/{name}", schema=schema, **json) for name in self._joints]
        self._wrench = Channel("/wrench", schema=_schema(Wrench, []), **json)
        self._arm = Channel("/arm", schema=_schema(ArmValues, []), **json)
        self._encode = msgspec.json.Encoder().encode
        self._lit: str | None = None
        self._finder = TouchFinder.of(snapshot)
        self._touch: TouchPoint | None = None
        self._count, self._draw_every = 0, draw_every

    def log(self, state: State, time_ns: int) -> None:
        """Log one tick at a Unix time [ns]."""
        touch = self._finder.see(state)
        touch = touch if touch is not None and touch.placed else None
        if touch is not self._touch:
            self._touch = touch
            self._touches.log(point_of_contact(touch, _stamp(time_ns)), log_time=time_ns)
        if self._count % self._draw_every == 0:
            self._draw(state, time_ns)
        self._count += 1
        for notice in state.notices:
            self._log.log(
                Log(timestamp=_stamp(time_ns), level=_LEVELS[notice.kind], message=notice.text,
                    name="contactd"),
                log_time=time_ns,
            )  # fmt: skip
        self._plot(state, time_ns)

    @property
    def watched(self) -> bool:
        """True if a viewer subscribed to any channel."""
        typed: tuple[Any, ...] = (
            self._transforms, self._scene, self._touches, self._states, self._log
        )  # fmt: skip
        return any(
            channel.has_sinks() for channel in (*typed, *self._values, self._arm, self._wrench)
        )

    def show_again(self) -> None:
        """Send the scene again with the next tick, for new viewers."""
        self._lit, self._count = None, 0

    def _plot(self, state: State, time_ns: int) -> None:
        columns = {name: getattr(state, name) for name in _VECTORS}
        for i, channel in enumerate(self._values):
            one = JointValues(
                **{name: values[i] for name, values in columns.items()},
                side=state.side[i],
                drive=state.drives[i],
                beside={name: row[i] for name, row in state.beside.items() if i < len(row)},
            )
            channel.log(self._encode(one), log_time=time_ns)
        t = state.timing
        arm = ArmValues(state.tick, state.mode, state.armed, state.cause, state.touched_link,
                        state.quiet_s, t.lateness_us, t.work_us, t.missed)  # fmt: skip
        self._arm.log(self._encode(arm), log_time=time_ns)
        if state.wrench is not None:
            self._wrench.log(self._encode(state.wrench), log_time=time_ns)

    def _draw(self, state: State, time_ns: int) -> None:
        stamp = _stamp(time_ns)
        transforms = []
        for frame in self._skeleton.frames:
            column = self._column.get(frame.joint)
            xyz, (x, y, z, w) = frame.at(0.0 if column is None else state.link_position[column])
            transforms.append(
                FrameTransform(
                    timestamp=stamp, parent_frame_id=frame.parent, child_frame_id=frame.child,
                    translation=_vector(xyz), rotation=Quaternion(x=x, y=y, z=z, w=w),
                )
            )  # fmt: skip
        self._transforms.log(FrameTransforms(transforms=transforms), log_time=time_ns)
        joints = [
            JointState(name=name, position=q, velocity=q_dot, effort=torque)
            for name, q, q_dot, torque in zip(
                self._joints, state.link_position, state.link_velocity, state.residual, strict=True
            )
        ]
        self._states.log(JointStates(timestamp=stamp, joints=joints), log_time=time_ns)
        lit = self._link_of.get(state.touched_link, "")
        if lit != self._lit:
            self._lit = lit
            self._scene.log(scene(self._skeleton, lit, stamp), log_time=time_ns)


def scene(skeleton: Skeleton, lit: str, stamp: Timestamp) -> SceneUpdate:
    """Scene with all links as capsules, those of link `lit` highlighted."""
    entities: dict[str, list[Capsule]] = {}
    for capsule in skeleton.capsules:
        entities.setdefault(capsule.link, []).append(capsule)
    return SceneUpdate(
        entities=[
            SceneEntity(
                timestamp=stamp,
                frame_id=link,
                id=link,
                frame_locked=True,
                cylinders=[_cylinder(one, _LIT if link == lit else _GREY) for one in capsules],
                spheres=[
                    ball
                    for one in capsules
                    for ball in _round_ends(one, _LIT if link == lit else _GREY)
                ],
            )
            for link, capsules in entities.items()
        ]
    )


def point_of_contact(touch: TouchPoint | None, stamp: Timestamp) -> SceneUpdate:
    """Scene with a ball as large as a contact point's uncertainty, or the last one's deletion."""
    if touch is None:
        gone = SceneEntityDeletion(
            timestamp=stamp, type=SceneEntityDeletionType.MatchingId, id=POINT
        )
        return SceneUpdate(deletions=[gone])
    size, (x, y, z) = 2.0 * touch.doubt_m, touch.point.tolist()
    ball = SpherePrimitive(
        pose=Pose(position=_vector((x, y, z)), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)),
        size=_vector((size, size, size)),
        color=_TOUCH,
    )
    one = SceneEntity(
        timestamp=stamp, frame_id=touch.link, id=POINT, frame_locked=True, spheres=[ball]
    )
    return SceneUpdate(entities=[one])


def _cylinder(one: Capsule, colour: Color) -> CylinderPrimitive:
    x, y, z, w = towards(one.end)
    middle = Vector3(x=0.5 * one.end[0], y=0.5 * one.end[1], z=0.5 * one.end[2])
    return CylinderPrimitive(
        pose=Pose(position=middle, orientation=Quaternion(x=x, y=y, z=z, w=w)),
        size=Vector3(x=2 * one.radius, y=2 * one.radius, z=one.length),
        bottom_scale=1.0,
        top_scale=1.0,
        color=colour,
    )


def _round_ends(one: Capsule, colour: Color) -> list[SpherePrimitive]:
    size = Vector3(x=2 * one.radius, y=2 * one.radius, z=2 * one.radius)
    level = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    return [
        SpherePrimitive(pose=Pose(position=_vector(at), orientation=level), size=size, color=colour)
        for at in ((0.0, 0.0, 0.0), one.end)
    ]


def _vector(xyz: tuple[float, float, float]) -> Vector3:
    return Vector3(x=xyz[0], y=xyz[1], z=xyz[2])


def _stamp(time_ns: int) -> Timestamp:
    return Timestamp(sec=time_ns // 10**9, nsec=time_ns % 10**9)
