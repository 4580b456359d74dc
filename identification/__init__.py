"""Parameters from measurements: gap, friction, rotor inertia, wiring, thresholds. Offline.

Pure mathematics on logs, as in `estimator`; but it needs scipy, which the daemon's
process never imports.
"""
