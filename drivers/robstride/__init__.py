"""RobStride motors on classic CAN, in their maker's own protocol."""
