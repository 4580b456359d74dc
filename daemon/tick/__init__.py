"""Work of one period: read, estimate, judge, decide, command. No I/O but the drives."""
