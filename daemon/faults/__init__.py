"""From samples and timing to findings, and what each asks of the arm. Pure."""
