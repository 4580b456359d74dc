"""`contactd`: commands that need no running daemon, and `fleet`, which watches running ones."""
