"""CAN interfaces: each opens its bus, and reads and writes frames at the cost of the tick."""
