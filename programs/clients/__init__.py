"""Programs beside the daemon, over the control socket: client, recorders, dashboard, replay."""
