"""Shared modules of contactd: arrays, elementary functions, errors, files, compiled modules."""
