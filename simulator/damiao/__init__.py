"""Damiao motors: a motor, its gear, two encoders and a controller in one, on classic CAN."""
