"""Supervision of stops of drives of any make: observation, deadlines, distances."""
