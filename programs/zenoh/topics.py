"""Topics of an arm: States as ROS 2 messages. Pure.

| topic | type | when |
|---|---|---|
| `joint_states` | JointState | every tick: q, q_dot, and as effort the motor's torque at the link |
| `external_torque` | JointState | every tick: the residual as effort; NaN: not sensing |
| `contact_threshold` | JointState | every tick: the threshold in force as effort |
| `wrench` | WrenchStamped | every tick: the force at the tool; NaN: mode without sensing |
| `wrench_covariance` | Float64MultiArray | every tick: covariance (9), strength, misfit |
| `contact` | DiagnosticStatus | at a contact: WARN; at a collision: ERROR |
| `robot_description` | String, latched | after joining the daemon: the URDF |
| `joint_targets` | JointState | subscribed with --allow-follow: targets to follow |
| `/diagnostics` | DiagnosticArray | every second, and when its content changes |
"""

import math
from typing import Final

from daemon.modes.table import SENSING
from daemon.protocol.state import Contact, Snapshot, State, Wrench
from programs.zenoh.messages import (
    Diagnosis,
    JointStates,
    Level,
    diagnostic_status,
    numbers,
    string,
    wrench_stamped,
)
from programs.zenoh.names import Endpoint, Kind, Node, Qos

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
#: Type and QoS of each topic, by its name in the namespace.
TOPICS: Final = {
    "joint_states": (JOINT_STATE, Qos.DEFAULT),
    "external_torque": (JOINT_STATE, Qos.DEFAULT),
    "contact_threshold": (JOINT_STATE, Qos.DEFAULT),
    "wrench": ("geometry_msgs/msg/WrenchStamped", Qos.DEFAULT),
    "wrench_covariance": ("std_msgs/msg/Float64MultiArray", Qos.DEFAULT),
    "contact": ("diagnostic_msgs/msg/DiagnosticStatus", Qos.DEFAULT),
    "robot_description": ("std_msgs/msg/String", Qos.LATCHED),
    "/diagnostics": ("diagnostic_msgs/msg/DiagnosticArray", Qos.DEFAULT),
}


TARGETS: Final = "joint_targets"


def targets(node: Node) -> Endpoint:
    """Subscription to targets."""
    return Endpoint(Kind.SUBSCRIPTION, node.absolute(TARGETS), JOINT_STATE, Qos.DEFAULT)


def endpoints(node: Node) -> dict[str, Endpoint]:
    """Publishers of the node, by the names in TOPICS."""
    return {
        name: Endpoint(Kind.PUBLISHER, node.absolute(name), type_name, qos)
        for name, (type_name, qos) in TOPICS.items()
    }


class Topics:
    """Encoder of one arm's messages, from its Snapshot."""

    def __init__(self, snapshot: Snapshot, arm: str) -> None:
        self._arm, self._axes = arm, snapshot.wrench_axes
        self._moving = JointStates(snapshot.joints, motion=True)
        self._torques = JointStates(snapshot.joints, motion=False)
        self.description = string(snapshot.urdf)

    def of(self, state: State) -> list[tuple[str, bytes]]:
        """Topic and payload of each message for this tick."""
        wall_s = state.timing.wall_s
        torque = self._moving.encode(
            wall_s, state.motor_torque, state.link_position, state.link_velocity
        )
        made = [
            ("joint_states", torque),
            ("external_torque", self._torques.encode(wall_s, external_torque(state))),
            ("contact_threshold", self._torques.encode(wall_s, state.threshold)),
        ]
        if state.wrench is not None:
            made += self._wrench(state, state.wrench)
        made += [
            ("contact", self._contact(notice.contact, state.touched_link))
            for notice in state.notices
            if notice.contact is not None
        ]
        return made

    def _wrench(self, state: State, wrench: Wrench) -> list[tuple[str, bytes]]:
        force = wrench.force if state.mode in SENSING else [math.nan] * 3
        xx, xy, xz, yy, yz, zz = wrench.covariance
        error = [xx, xy, xz, xy, yy, yz, xz, yz, zz, wrench.strength, wrench.misfit]
        return [
            ("wrench", wrench_stamped(state.timing.wall_s, self._axes, force)),
            ("wrench_covariance", numbers(error)),
        ]

    def _contact(self, contact: Contact, link: str) -> bytes:
        level = Level.ERROR if contact.level == "collision" else Level.WARN
        values = (
            ("joint", contact.joint),
            ("torque", f"{contact.torque:.6g}"),
            ("threshold", f"{contact.threshold:.6g}"),
            ("level", contact.level),
            ("side", contact.side),
            ("link", link),
        )
        text = f"{contact.level} at {contact.joint}: {contact.torque:+.2f} Nm"
        return diagnostic_status(Diagnosis(level, contact.joint, text, self._arm, values))


def external_torque(state: State) -> list[float]:
    """Residual [Nm], NaN for joints that do not sense contact now."""
    if state.sensing is None or all(state.sensing):
        return state.residual
    return [
        torque if senses else math.nan
        for torque, senses in zip(state.residual, state.sensing, strict=True)
    ]
