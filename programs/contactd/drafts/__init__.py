"""Drafts of a configuration, from a URDF and EDS files."""
