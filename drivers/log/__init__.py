"""Placeholder for drives: joints of an arm known only from logs."""
