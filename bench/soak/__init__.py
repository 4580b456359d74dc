"""Soak test: hours with an arm, a hand, faults and people, all at random."""
