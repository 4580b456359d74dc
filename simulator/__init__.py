"""Simulated arm on the bus: two-mass joints with gaps and friction, drives, and a human hand."""
