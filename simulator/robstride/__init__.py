"""RobStride motors with integrated gear, encoder and controller, on CAN with 29-bit identifiers."""
