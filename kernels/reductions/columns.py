"""Columns of the measures of a whole state, in float64."""

FIRST, STRAIN, KINETIC, POTENTIAL, WORK = 0, 1, 2, 3, 4
"""Less the first particle that is not finite, or less NONE; largest |l / l0 − 1|, 0 where nobody looks; three [J].

The kinetic energy is that of the method's own velocities.
"""
LOOKED = 5
"""Number of columns, from the first on, that show divergence."""
MEAN_KINETIC, SWING, MOMENTUM, ANGULAR_MOMENTUM, ELASTIC, DISSIPATED = 5, 6, 7, 10, 13, 14
"""Kinetic energy of velocities at the instant of the positions [J], that of what these differ by from the others
[J], three [kg m/s], three [kg m²/s], [J] and [W]: `sum_up` finds these too."""
COLUMNS = 15
MAXIMA = 2
"""Number of columns, from the first on, that are maxima over threads; the others are sums."""
NONE = 2147483647
