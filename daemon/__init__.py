"""The service: configuration, loop, modes, limits, supervisor, control socket, command lines."""
