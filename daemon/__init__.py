"""The daemon: configuration, loop, modes, limits, faults, control socket."""
