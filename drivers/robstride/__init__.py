"""RobStride motors on classic CAN, in their proprietary protocol."""
