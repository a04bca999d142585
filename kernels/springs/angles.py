"""Angles of rods that resist bending (see `msdwarp.bodies.angles`): forces, energies and bounds.

With e from a to b, f from b to c, C = cos θ and T = tan(θ/2), the energy 2 K T² = 2 K (1 − C)/(1 + C) gives the
forces 4 K/(1 + C)² ∂C/∂x. The damper adds −D θ' ∂θ/∂x. Both conserve momentum and angular momentum.
"""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..effect import ElementForce, ForceTerm, instant
from ..records import records
from .force_algorithm import difference, velocity_of
from .law import TINY

FOLDED = 1e-4
"""Least 1 + cos θ in the force law, which is singular for a line folded back on itself."""
STRAIGHT = 1e-6
"""Least sin θ for damping: a straight line has no plane of bending."""


@functools.cache
def bending_force(dim: int, scalar: type):
    """Compose bend(e, f, ve, vf, K, D) -> (force on a, force on c); the force on b is minus their sum.

    ve and vf are the time derivatives of e and f [m/s].
    """
    V = vector(dim, scalar)
    tiny = TINY[scalar]

    @wp.func
    def bend(e: V, f: V, ve: V, vf: V, stiffness: scalar, damping: scalar):
        one = scalar(1.0)
        of_e = one / wp.sqrt(wp.dot(e, e) + scalar(tiny))
        of_f = one / wp.sqrt(wp.dot(f, f) + scalar(tiny))
        p = of_e * e
        q = of_f * f
        cosine = wp.dot(p, q)
        across = q - cosine * p
        # ∂C/∂x_a and ∂C/∂x_c:
        at_a = -of_e * across
        at_c = of_f * (p - cosine * q)
        half = wp.max(one + cosine, scalar(FOLDED))
        size = scalar(4.0) * stiffness / (half * half)
        square = wp.dot(across, across)  # sin²θ
        if square > scalar(STRAIGHT * STRAIGHT):
            # C' = −∂C/∂x_a·ve + ∂C/∂x_c·vf, since x_b − x_a = e; and θ' ∂θ/∂x = C' ∂C/∂x / sin²θ.
            rate = wp.dot(at_c, vf) - wp.dot(at_a, ve)
            size -= damping * rate / square
        return size * at_a, size * at_c

    return bend


@functools.cache
def angle_forces(dim: int, scalar: type, compensated: bool, damped: bool) -> ForceTerm:
    """Return the term of angles: the sum of angles' forces on a particle."""
    V, Instant = vector(dim, scalar), instant(dim, scalar, compensated)
    load, separation = records(dim, scalar).load, difference(dim, scalar, compensated)
    bend, velocity = bending_force(dim, scalar), velocity_of(dim, scalar, damped)

    @wp.struct
    class AngleTable:
        first: wp.array(dtype=int)  # row starts of `entry`, shape [particle_count + 1]
        entry: wp.array(dtype=int)  # 3 · angle + the particle's position (0, 1, 2) in it, shape [3 angle_count]
        # Of each angle, shape [angle_count]:
        particles: wp.array(dtype=wp.vec3i)
        stiffness: wp.array(dtype=scalar)  # K [N m]
        damping: wp.array(dtype=scalar)  # D [N m s]

    @wp.func
    def bent(data: AngleTable, now: Instant, i: int) -> V:
        total = V()
        for n in range(data.first[i], data.first[i + 1]):
            angle = data.entry[n] / 3
            place = data.entry[n] % 3
            three = data.particles[angle]
            e = separation(now.compensation, now.x, load(now.x, three[1]), three[1], three[0])
            f = separation(now.compensation, now.x, load(now.x, three[2]), three[2], three[1])
            ve = velocity(now.v, three[1]) - velocity(now.v, three[0])
            vf = velocity(now.v, three[2]) - velocity(now.v, three[1])
            on_a, on_c = bend(e, f, ve, vf, data.stiffness[angle], data.damping[angle])
            if place == 0:
                total += on_a
            elif place == 2:
                total += on_c
            else:
                total -= on_a + on_c
        return total

    return ForceTerm("angles", AngleTable, force=bent, selective=True)


@functools.cache
def angle_law(dim: int, scalar: type, AngleTable: Any):
    """Compose the law of an angle: φ·F, for `adjoint.elements`."""
    bend = bending_force(dim, scalar)
    Rows: Any = wp.types.matrix((3, dim), scalar)

    @wp.func
    def projected(angles: AngleTable, n: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows) -> scalar:
        stiffness, damping = angles.stiffness[n], angles.damping[n]
        on_a, on_c = bend(x[1] - x[0], x[2] - x[1], v[1] - v[0], v[2] - v[1], stiffness, damping)
        return wp.dot(on_a, phi[0] - phi[1]) + wp.dot(on_c, phi[2] - phi[1])

    return ElementForce(projected=projected, points=3)


@functools.cache
def angle_energies(dim: int, scalar: type, AngleTable: Any):
    """Compose the kernel, over worlds and angles, of the stored energy and dissipated power of each angle."""
    V, Row = vector(dim, scalar), vector(dim, wp.float64)

    @kernel
    def find_angle_energies(
        # Model:
        angles: AngleTable,
        stride: int,  # particles from one world to the next
        # State in:
        x: wp.array(dtype=V),  # [m], of all worlds
        v: wp.array(dtype=V),  # [m/s]
        # Out, shape [worlds, angle_count]:
        energy: wp.array2d(dtype=wp.float64),  # [J]
        power: wp.array2d(dtype=wp.float64),  # [W]
    ):
        w, n = wp.tid()
        a = w * stride + angles.particles[n][0]
        b = w * stride + angles.particles[n][1]
        c = w * stride + angles.particles[n][2]
        e = Row(x[b]) - Row(x[a])
        f = Row(x[c]) - Row(x[b])
        one = wp.float64(1.0)
        p = wp.normalize(e)
        q = wp.normalize(f)
        cosine = wp.dot(p, q)
        half = wp.max(one + cosine, wp.float64(FOLDED))
        bent = p - q  # |p − q|² is 2 (1 − C), without the cancellation in small angles
        energy[w, n] = wp.float64(angles.stiffness[n]) * wp.dot(bent, bent) / half
        square = one - cosine * cosine
        power[w, n] = wp.float64(0.0)
        if square > wp.float64(STRAIGHT * STRAIGHT):
            ve = Row(v[b]) - Row(v[a])
            vf = Row(v[c]) - Row(v[b])
            rate = wp.dot(p - cosine * q, vf) / wp.length(f) + wp.dot(q - cosine * p, ve) / wp.length(e)
            power[w, n] = wp.float64(angles.damping[n]) * rate * rate / square

    return find_angle_energies


@functools.cache
def angle_blocks(dim: int, scalar: type, AngleTable: Any):
    """Compose the kernel that adds a bound of each angle's stiffness to the diagonal blocks of its particles.

    θ changes by g·u, where |g| is 1/|e|, 1/|e| + 1/|f| and 1/|f| at a, b and c. The matrix g gᵀ is at most the
    blocks |g_i| Σ|g|, exact for the fastest mode of a straight rod. It is multiplied by ∂²(2 K T²)/∂θ² =
    K (1 + T²)(1 + 3 T²). Half of the product is added, since the bound doubles blocks.
    """
    V, Row = vector(dim, scalar), vector(dim, wp.float64)
    Block = wp.types.matrix((dim, dim), wp.float64)

    @kernel
    def add_angle_blocks(
        angles: AngleTable,
        # State in:
        x: wp.array(dtype=V),  # [m], shape [particle_count]
        # Out:
        stiffness: wp.array(dtype=Block),  # A_i [N/m], shape [particle_count]
        damping: wp.array(dtype=Block),  # B_i [N s/m], shape [particle_count]
    ):
        n = wp.tid()
        three = angles.particles[n]
        e = Row(x[three[1]]) - Row(x[three[0]])
        f = Row(x[three[2]]) - Row(x[three[1]])
        of_e = wp.float64(1.0) / wp.length(e)
        of_f = wp.float64(1.0) / wp.length(f)
        half = wp.max(wp.float64(1.0) + wp.dot(e, f) * of_e * of_f, wp.float64(FOLDED))
        square = wp.float64(2.0) / half - wp.float64(1.0)  # T²
        bent = (wp.float64(1.0) + square) * (wp.float64(1.0) + wp.float64(3.0) * square)
        for k in range(3):
            own = of_e + of_f
            if k == 0:
                own = of_e
            if k == 2:
                own = of_f
            size = own * (of_e + of_f)  # half of |g_i| Σ|g|
            whole = size * wp.identity(dim, wp.float64)
            wp.atomic_add(stiffness, three[k], wp.float64(angles.stiffness[n]) * bent * whole)
            wp.atomic_add(damping, three[k], wp.float64(angles.damping[n]) * whole)

    return add_angle_blocks
