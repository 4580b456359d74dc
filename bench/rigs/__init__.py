"""Simulated set-ups that benches and tests use."""
