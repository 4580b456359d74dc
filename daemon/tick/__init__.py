"""Work of one period: read, estimate, detect faults, decide, command. No I/O except the drives'."""
