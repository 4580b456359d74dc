"""`contactd simulate`: simulates an arm on the configured bus."""
