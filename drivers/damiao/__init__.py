"""Damiao motors on classic CAN."""
