"""Modes of motion, and what a contact leads to: tables. Pure."""
