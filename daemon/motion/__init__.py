"""Target velocities from mode and measurements: paths, admittance, limits. Pure."""
