"""From mode and measurements to target velocities: paths, admittance, limits. Pure."""
