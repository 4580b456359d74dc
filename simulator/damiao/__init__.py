"""Damiao motors with integrated gear, two encoders and controller, on classic CAN."""
