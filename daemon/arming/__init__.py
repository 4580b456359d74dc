"""Arming: its checks, and the lease on the armed arm."""
