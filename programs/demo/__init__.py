"""`contactd demo`: the paper's third experiment on a simulated arm."""
