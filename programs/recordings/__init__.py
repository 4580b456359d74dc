"""Evaluation of recordings, without a daemon: contents, plots, what-ifs, other formats."""
