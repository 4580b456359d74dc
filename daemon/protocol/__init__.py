"""Protocol of the control socket, shared by daemon and clients: messages, lease, path. Pure."""
