"""The mathematics of contactd. No input or output, no clock, no threads."""
