"""`contactd simulate`: a simulated arm on a bus of its own."""
