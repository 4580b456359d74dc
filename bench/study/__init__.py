"""Populations, scores and reports behind the commands of bench."""
