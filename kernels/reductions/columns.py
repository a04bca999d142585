"""Columns in the table of measures: sums and extremes of a state, in float64, one row per world."""

FIRST, STRAIN, KINETIC, POTENTIAL, WORK = 0, 1, 2, 3, 4
"""Minus the index of the first non-finite particle, or −NONE; largest |l / l0 − 1|, or 0; three energies [J].

The kinetic energy is computed from the method's own velocities.
"""
LOOKED = 5
"""Number of leading columns, which suffice to detect divergence."""
MEAN_KINETIC, SWING, MOMENTUM, ANGULAR_MOMENTUM, ELASTIC, DISSIPATED = 5, 6, 7, 10, 13, 14
"""Kinetic energy of velocities at the time of positions, and of their difference from the method's velocities [J];
momentum [kg m/s], angular momentum [kg m²/s], three columns each; elastic energy [J]; dissipated power [W]."""
COLUMNS = 15
MAXIMA = 2
"""Number of leading columns that are maxima over threads; other columns are sums."""
NONE = 2147483647
