"""Tables of motion modes and of reactions to contact. Pure data."""
