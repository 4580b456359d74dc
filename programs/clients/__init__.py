"""Clients of the daemon's control socket: client, recorders, dashboard; and the replay."""
