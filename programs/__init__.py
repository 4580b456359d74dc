"""Programs beside the daemon: one folder a program, and what they share."""
