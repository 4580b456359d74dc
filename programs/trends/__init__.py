"""Trends of the gears, day by day, gathered and written by a process of its own beside
`contactd run`."""
