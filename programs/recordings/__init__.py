"""Answers from recordings: contents, plots, what-ifs, other formats. No daemon is asked."""
