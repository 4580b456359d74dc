"""Configuration of one arm: its schema, its strict reading, its cross-checks."""
