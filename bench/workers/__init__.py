"""Workers of paired measurements: one file each, run on today's code and on the code before."""
