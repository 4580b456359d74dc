"""Fault detection: from samples and timing to findings and responses. Pure."""
