"""Command lines `contactd` and `contactctl`."""
