"""Service around the loop, in the slack between two ticks: socket, log, permission, systemd."""
