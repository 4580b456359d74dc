"""Factory settings of a drive: its objects with ratings, serial number and guards."""

from pathlib import Path

from simulator.description import JointDescription
from simulator.guards import guard_pdos, guard_values
from simulator.objects import Objects, key


def factory_settings(eds: Path, about: JointDescription, serial_number: int) -> Objects:
    """Objects of the drive of a joint. Raises ConfigurationError if its EDS is missing or
    unreadable."""
    objects = Objects(eds, about.node)
    peak = round(1000.0 * about.max_current_A / about.rated_current_A)
    rated_torque = about.rated_current_A * about.torque_constant / about.gear
    for where, value in (
        (key(0x6075), round(1000.0 * about.rated_current_A)),
        (key(0x6076), round(1000.0 * rated_torque)),
        (key(0x6072), peak),
        (key(0x6073), peak),
        (key(0x1018, 4), serial_number),
    ):
        objects.set_default(where, value)
    guard_values(objects, peak)
    guard_pdos(objects)
    return objects
