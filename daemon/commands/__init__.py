"""The command lines `contactd` and `contactctl`."""
