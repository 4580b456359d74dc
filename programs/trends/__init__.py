"""Daily trends of the gears, gathered and written by a separate process beside `contactd run`."""
