"""RobStride motors: a motor, its gear, encoder and controller in one, on CAN with 29-bit ids."""
