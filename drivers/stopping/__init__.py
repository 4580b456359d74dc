"""Stops of drives, whichever make they are: seen, timed, measured."""
