"""FIRE (fast inertial relaxation engine): moves a body to a minimum of energy.

After each substep, with its acceleration a, and norms weighted by mass, velocities become

    v ← (1 − α) v + α |v| a/|a|  if a·v > 0, and 0 otherwise,

and positions are corrected as if these had been the substep's velocities.

α is 0.1 initially and after each stop. It decreases by 1 % per substep after a·v > 0 in five successive substeps.
The substep h is constant, about the largest stable one. The factor α |v|/|a| of a effectively stiffens springs. It
is limited to h: then the method is stable if h² λ < 2 for the fastest mode.
Reference: Bitzek, Koskinen, Gähler, Moseler and Gumbsch, Structural relaxation made simple, Phys. Rev. Lett. 97
(2006) 170201.
"""

import functools

import warp as wp

from ..basis import kernel
from ..compensation import state_types
from ..records import records

THREADS = 256
"""Number of threads that sum over a body on a GPU."""
POWER, SPEED, ACCELERATION, RESIDUAL = 0, 1, 2, 3
"""Rows of sums: Σ m a·v, Σ m v², Σ m a², and the largest m |a|."""
ROWS = 4
KEPT, TOWARDS, MIXING, LASTING, LARGEST_FORCE, STRONGEST = 0, 1, 2, 3, 4, 5
"""Columns of `decision`: factors of v and of a, α, number of successive substeps with a·v > 0, largest force on a
particle [N], and the maximum of this force so far."""
COLUMNS = 6
MIXING_AT_START, MIXING_FALLS, LASTS = 0.1, 0.99, 5.0


@functools.cache
def fire_sums(dim: int, scalar: type):
    """Compose the kernel, over THREADS threads or one, that computes the method's sums over particles (ROWS)."""
    _, Vectors, _ = state_types(dim, scalar, False)
    load = records(dim, scalar).load

    @kernel
    def sum_power(
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        before: Vectors,  # velocities at a substep's start [m/s]
        after: Vectors,  # velocities at the substep's end
        dt: scalar,  # [s]
        # Out:
        sums: wp.array2d(dtype=wp.float64),  # shape [ROWS, threads]
    ):
        thread = wp.tid()
        power = wp.float64(0.0)
        speed = wp.float64(0.0)
        acceleration = wp.float64(0.0)
        residual = wp.float64(0.0)
        i = thread
        while i < inverse_mass.shape[0]:
            if inverse_mass[i] > scalar(0.0):
                m = wp.float64(1.0) / wp.float64(inverse_mass[i])
                v = load(after, i)
                a = (v - load(before, i)) / dt
                square = wp.float64(wp.dot(a, a))
                power += m * wp.float64(wp.dot(a, v))
                speed += m * wp.float64(wp.dot(v, v))
                acceleration += m * square
                residual = wp.max(residual, m * wp.sqrt(square))
            i += sums.shape[1]
        sums[wp.static(POWER), thread] = power
        sums[wp.static(SPEED), thread] = speed
        sums[wp.static(ACCELERATION), thread] = acceleration
        sums[wp.static(RESIDUAL), thread] = residual

    return sum_power


@kernel
def fire_decision(
    sums: wp.array2d(dtype=wp.float64),  # shape [ROWS, threads], for a block with this number of threads
    dt: wp.float64,  # [s]
    # In and out:
    decision: wp.array(dtype=wp.float64),  # shape [COLUMNS]
):
    """Decide how velocities and accelerations are mixed."""
    thread = wp.tid()
    own = wp.float64(sums[wp.static(POWER), thread])
    power = wp.tile_extract(wp.tile_sum(wp.tile(own)), 0)
    own = wp.float64(sums[wp.static(SPEED), thread])
    speed = wp.tile_extract(wp.tile_sum(wp.tile(own)), 0)
    own = wp.float64(sums[wp.static(ACCELERATION), thread])
    acceleration = wp.tile_extract(wp.tile_sum(wp.tile(own)), 0)
    own = wp.float64(sums[wp.static(RESIDUAL), thread])
    residual = wp.tile_extract(wp.tile_max(wp.tile(own)), 0)
    if thread == 0:
        decision[wp.static(LARGEST_FORCE)] = residual
        decision[wp.static(STRONGEST)] = wp.max(decision[wp.static(STRONGEST)], residual)
        if power > wp.float64(0.0) and acceleration > wp.float64(0.0):
            mixing = decision[wp.static(MIXING)]
            decision[wp.static(KEPT)] = wp.float64(1.0) - mixing
            decision[wp.static(TOWARDS)] = wp.min(mixing * wp.sqrt(speed / acceleration), dt)
            lasting = decision[wp.static(LASTING)] + wp.float64(1.0)
            decision[wp.static(LASTING)] = lasting
            if lasting > wp.float64(wp.static(LASTS)):
                decision[wp.static(MIXING)] = wp.float64(wp.static(MIXING_FALLS)) * mixing
        else:
            decision[wp.static(KEPT)] = wp.float64(0.0)
            decision[wp.static(TOWARDS)] = wp.float64(0.0)
            decision[wp.static(LASTING)] = wp.float64(0.0)
            decision[wp.static(MIXING)] = wp.float64(wp.static(MIXING_AT_START))


@functools.cache
def fire_mixing(dim: int, scalar: type):
    """Compose the kernel, over particles, that mixes velocities with accelerations, and corrects positions."""
    _, Vectors, _ = state_types(dim, scalar, False)
    load, store, _ = records(dim, scalar)

    @kernel
    def mix_velocities(
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        before: Vectors,  # velocities at a substep's start [m/s]
        dt: scalar,  # [s]
        decision: wp.array(dtype=wp.float64),  # shape [COLUMNS]
        # In and out:
        x: Vectors,  # positions at the substep's end [m]
        after: Vectors,  # velocities at the substep's end
    ):
        i = wp.tid()
        if inverse_mass[i] > scalar(0.0):
            v = load(after, i)
            a = (v - load(before, i)) / dt
            mixed = scalar(decision[wp.static(KEPT)]) * v + scalar(decision[wp.static(TOWARDS)]) * a
            store(after, i, mixed)
            store(x, i, load(x, i) + dt * (mixed - v))

    return mix_velocities
