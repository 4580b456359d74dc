"""Configuration of one arm: schema, strict parsing, and cross-checks."""
