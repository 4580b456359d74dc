"""Other processes, over the control socket: client, recorders, dashboard, replay."""
