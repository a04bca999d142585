"""Watching a run from the device: energies, and the first particle that is no longer finite."""

import functools

import warp as wp

from ..basis import kernel, vector

KINETIC, POTENTIAL = 0, 1
"""Columns of the energies that `look_over` sums."""


@functools.cache
def look_over(dim: int, scalar: type):
    """Compose the kernel that sums energies and lowers `first[0]` to the least particle that is not finite.

    Each thread sums the kinetic and gravitational energies of a share of the particles, in float64; pinned ones
    have none.
    """
    V = vector(dim, scalar)

    @kernel
    def look_over_particles(
        # Model:
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        gravity: V,  # [m/s²]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        v: wp.array(dtype=V),  # velocities [m/s], shape [particle_count]
        # Out:
        first: wp.array(dtype=int),  # particle_count before; shape [1]
        energies: wp.array2d(dtype=wp.float64),  # [J], shape [thread_count, 2]
    ):
        share = wp.tid()
        i = share
        kinetic = wp.float64(0.0)
        potential = wp.float64(0.0)
        while i < x.shape[0]:
            if not (wp.isfinite(x[i]) and wp.isfinite(v[i])):
                wp.atomic_min(first, 0, i)
            w = wp.float64(inverse_mass[i])
            if w > wp.float64(0.0):
                square = wp.float64(0.0)
                fall = wp.float64(0.0)
                for k in range(wp.static(dim)):
                    speed = wp.float64(v[i][k])
                    square += speed * speed
                    fall += wp.float64(gravity[k]) * wp.float64(x[i][k])
                kinetic += wp.float64(0.5) * square / w
                potential -= fall / w
            i += energies.shape[0]
        energies[share, wp.static(KINETIC)] = kinetic
        energies[share, wp.static(POTENTIAL)] = potential

    return look_over_particles
