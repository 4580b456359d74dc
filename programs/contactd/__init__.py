"""`contactd`: the commands that need no running daemon, and `fleet` beside one."""
