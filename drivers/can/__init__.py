"""CAN interfaces: each opens its bus, and reads and writes frames fast enough for the tick."""
