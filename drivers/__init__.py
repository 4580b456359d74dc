"""Drives on the CAN bus: bus access, boot-up, drive states, codecs, and the arm as arrays."""
