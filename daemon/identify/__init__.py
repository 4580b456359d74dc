"""`contactd identify`: a process of its own beside the daemon, or on a recorded log."""
