"""Both ends of the control socket: what is said, who may arm, where it is. Pure."""
