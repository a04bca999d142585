"""The linearised force law: products with K and B, and the diagonal blocks of both."""

import functools

import warp as wp

from ..basis import kernel, vector
from .dampers import LINEAR
from .spring_laws import Laws, connection_table, spring_stress, steepest_slope


@functools.cache
def add_linearised(dim: int, scalar: type, everyone: bool = False):
    """Compose the kernel, over springs, of z += scale (spring·K + damper·B) p, with K and B linearised at x.

    Rows and columns of pinned and driven particles are 0 unless `everyone`.

    A spring of axis d adds k (d dᵀ + max(0, 1 − l0/l)(1 − d dᵀ)) to K, and b d dᵀ to B. The negative transverse
    stiffness of compressed springs is omitted, so that K is never indefinite.
    """
    V = vector(dim, scalar)

    @kernel
    def add_linearised_product(
        # Model:
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array(dtype=scalar),  # l0 [m], shape [connection_count]
        stiffness: wp.array(dtype=scalar),  # k [N/m], shape [connection_count]
        damping: wp.array(dtype=scalar),  # b, steepest slope of the law [N s/m], shape [connection_count]
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        # The product:
        p: wp.array(dtype=V),  # shape [particle_count]
        spring: scalar,
        damper: scalar,
        scale: scalar,
        # Out:
        z: wp.array(dtype=V),  # shape [particle_count]
    ):
        c = wp.tid()
        i = connections[c][0]
        j = connections[c][1]
        dx = x[i] - x[j]
        length = wp.length(dx)
        if length == scalar(0.0):
            return
        axis = dx / length
        counts_i = wp.static(everyone) or inverse_mass[i] > scalar(0.0)
        counts_j = wp.static(everyone) or inverse_mass[j] > scalar(0.0)
        dp = V()
        if counts_i:
            dp += p[i]
        if counts_j:
            dp -= p[j]
        across = wp.max(scalar(0.0), scalar(1.0) - rest_length[c] / length)
        k = scale * spring * stiffness[c]
        b = scale * damper * damping[c]
        part = (k * (scalar(1.0) - across) + b) * wp.dot(axis, dp) * axis + k * across * dp
        if counts_i:
            wp.atomic_add(z, i, part)
        if counts_j:
            wp.atomic_sub(z, j, part)

    return add_linearised_product


@functools.cache
def add_blocks(dim: int, scalar: type, laws: Laws):
    """Compose the kernel, over worlds and springs, that adds each spring to the blocks A and B of its particles.

    A_i = Σ k (d dᵀ + max(0, 1 − l0/l)(1 − d dᵀ)) and B_i = Σ b d dᵀ, for the axis d of each spring of i. For a
    nonlinear law k d dᵀ is multiplied by its steepest slope, and the transverse factor is max(0, l0 s/l).
    """
    form, (Connected, law_of) = laws.spring or LINEAR, connection_table(scalar, laws)
    steepest, stress = steepest_slope(form), spring_stress(wp.float64, form)
    V, Block = vector(dim, scalar), wp.types.matrix((dim, dim), wp.float64)

    @kernel
    def add_connection_blocks(
        connections: Connected,  # with b the steepest slope of the law [N s/m]
        # State in:
        x: wp.array(dtype=V),  # positions [m], of all worlds
        stride: int,  # particles from one world to the next
        # Out:
        stiffness_block: wp.array2d(dtype=Block),  # A_i, 0 before [N/m], shape [worlds, particle_count]
        damping_block: wp.array2d(dtype=Block),  # B_i, 0 before [N s/m], shape [worlds, particle_count]
    ):
        w, c = wp.tid()
        i = connections.ends[c][0]
        j = connections.ends[c][1]
        dx = x[w * stride + i] - x[w * stride + j]
        length = wp.length(dx)
        if length == scalar(0.0):
            return
        axis = dx / length
        l0 = wp.float64(connections.rest_length[w % connections.rest_length.shape[0], c])
        across = wp.max(wp.float64(0.0), wp.float64(1.0) - l0 / wp.float64(length))
        slope = wp.float64(1.0)
        if wp.static(laws.spring is not None):
            strain = wp.float64(length) / l0 - wp.float64(1.0)
            law = law_of(connections, c)
            slope = steepest(strain, law)
            across = wp.max(wp.float64(0.0), stress(strain, law) * l0 / wp.float64(length))
        along = Block()
        spring = Block()
        for p in range(wp.static(dim)):
            for q in range(wp.static(dim)):
                along[p, q] = wp.float64(axis[p]) * wp.float64(axis[q])
                spring[p, q] = (slope - across) * along[p, q]
            spring[p, p] += across
        spring = wp.float64(connections.stiffness[w % connections.stiffness.shape[0], c]) * spring
        along = wp.float64(connections.damping[w % connections.damping.shape[0], c]) * along
        wp.atomic_add(stiffness_block, w, i, spring)
        wp.atomic_add(stiffness_block, w, j, spring)
        wp.atomic_add(damping_block, w, i, along)
        wp.atomic_add(damping_block, w, j, along)

    return add_connection_blocks
