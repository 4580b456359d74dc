"""The service: configuration, loop, modes, limits, faults, control socket."""
