"""ROS 2 type hashes of `programs/zenoh/type_hashes.py`, by ros2-pyterfaces.

Never typed: one wrong digit means silence.
"""

from typing import Final

from ros2_pyterfaces.core import all_msgs, all_srvs, hash_rihs01

TYPES: Final = (
    "diagnostic_msgs/msg/DiagnosticArray",
    "diagnostic_msgs/msg/DiagnosticStatus",
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Float64MultiArray",
    "std_msgs/msg/String",
    "std_srvs/srv/SetBool",
    "std_srvs/srv/Trigger",
)

HEAD: Final = '''"""Hashes of types of ROS 2 (REP 2016), from Jazzy on.

Made from the definitions in ros2-pyterfaces by `make reference`: never change one by hand.
"""

from typing import Final

TYPE_HASHES: Final = {
'''


def type_hashes() -> str:
    """programs/zenoh/type_hashes.py."""
    lines = []
    for name in TYPES:
        _, space, short = name.split("/")
        definitions = all_msgs if space == "msg" else all_srvs
        lines.append(f'    "{name}": "{hash_rihs01(getattr(definitions, short))}",  # noqa: E501')
    return HEAD + "\n".join(lines) + "\n}\n"
