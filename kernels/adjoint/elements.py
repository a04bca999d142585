"""The adjoint of forces of elements; an element is a few points, such as the corners of a triangle or a cell.

A point is a particle, or a weighted mean of particles. Warp differentiates φ·F, the sum over the points of an
element; each element writes its derivatives, then each particle sums the derivatives of its points in fixed order.
"""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..effect import ElementForce
from ..records import records


@functools.cache
def elements_adjoint(dim: int, scalar: type, Data: Any, law: ElementForce, wanted: int):
    """Compose the kernel, over elements, that writes ∂(φ·F)/∂x and ∂(φ·F)/∂v of each point.

    Derivatives by the first `wanted` numbers of elements are summed.
    """
    V, load = vector(dim, scalar), records(dim, scalar).load
    evaluate, numbers, width, points, of_particles, shared, project = law
    Rows, Own = wp.types.matrix((points, dim), scalar), vector(width, scalar) if width else scalar

    @wp.func
    def along(data: Data, e: int, time: scalar, stage: int, x: Rows, v: Rows, push: V, own: Own) -> scalar:
        return wp.dot(evaluate(data, e, time, stage, x, v, own), push)

    @kernel
    def propagate_elements(
        data: Data,
        count: int,  # elements of a world; below, particles from one world to the next
        stride: int,
        particle: wp.array2d(dtype=int),  # of point k of element e in row e · points + k; -1 for no particle
        weight: wp.array2d(dtype=scalar),  # of these particles in the point
        time: wp.array(dtype=scalar),  # of each stage of a frame [s]; one entry if no force depends on time
        stage: int,
        # State, at which the force was evaluated:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        phi: wp.array(dtype=V),  # ∂L/∂F of each particle
        # Out, in the same rows:
        by_x: wp.array(dtype=V),
        by_v: wp.array(dtype=V),
        by_numbers: wp.array2d(dtype=scalar),  # in and out, shape [any, wanted]
        begin: int,  # elements of this launch
        end: int,
        threads: int,  # of the launch
    ):
        e = begin + wp.tid()
        while e < end:
            places = Rows()
            rates = Rows()
            phis = Rows()
            for k in range(wp.static(points)):
                row = e * wp.static(points) + k
                for m in range(particle.shape[1]):
                    i = particle[row, m]
                    if i >= 0:
                        w = weight[row, m]
                        places[k] = places[k] + w * load(x, i)
                        rates[k] = rates[k] + w * load(v, i)
                        phis[k] = phis[k] + w * load(phi, i)
            own = e % count
            if wp.static(of_particles):
                own = particle[e, 0] % stride
            seconds = time[wp.min(stage, time.shape[0] - 1)]
            if wp.static(evaluate is None):
                _d, _e, _t, _s, of_x, of_v, _phi = wp.grad(project)(data, own, seconds, stage, places, rates, phis)
            else:
                push = V()
                for k in range(wp.static(points)):
                    push += phis[k]
                if wp.static(shared):
                    push = push / scalar(points)
                _d, _e, _t, _s, of_x, of_v, _push, of_numbers = wp.grad(along)(
                    data, own, seconds, stage, places, rates, push, numbers(data, own, stage)
                )
                for k in range(wp.static(wanted)):
                    by_numbers[e, k] = by_numbers[e, k] + of_numbers[k]
            for k in range(wp.static(points)):
                by_x[e * wp.static(points) + k] = of_x[k]
                by_v[e * wp.static(points) + k] = of_v[k]
            e += threads

    return propagate_elements


@functools.cache
def add_elements(dim: int, scalar: type):
    """Compose the kernel, over the particles of elements, that sums derivatives by their points."""
    V, (load, store, _) = vector(dim, scalar), records(dim, scalar)

    @kernel
    def add_points(
        member: wp.array(dtype=int),  # the particles
        first: wp.array(dtype=int),  # row starts of `entry`, shape [member count + 1]
        entry: wp.array(dtype=int),  # rows of the points of each particle
        weight: wp.array(dtype=scalar),  # of the particle in each point
        of_x: wp.array(dtype=V),
        of_v: wp.array(dtype=V),
        # In and out, derivatives by:
        by_x: wp.array(dtype=V),
        by_v: wp.array(dtype=V),
        begin: int,  # members of this launch
        end: int,
        threads: int,  # of the launch
    ):
        m = begin + wp.tid()
        while m < end:
            i = member[m]
            sum_x = load(by_x, i)
            sum_v = load(by_v, i)
            for n in range(first[m], first[m + 1]):
                sum_x += weight[n] * of_x[entry[n]]
                sum_v += weight[n] * of_v[entry[n]]
            store(by_x, i, sum_x)
            store(by_v, i, sum_v)
            m += threads

    return add_points


@functools.cache
def sum_numbers(scalar: type):
    """Compose the kernel that sums derivatives by the numbers of elements over each group, then resets them to 0.

    A thread block sums one number of a group in a world: each thread a part, then all parts in a fixed order.
    """

    @kernel
    def sum_groups(
        first: wp.array(dtype=int),  # row starts of `entry`, shape [group_count + 1]
        entry: wp.array(dtype=int),  # elements of each group
        count: int,  # elements of a world
        row: int,
        # In and out:
        each: wp.array2d(dtype=scalar),  # shape [worlds count, k]
        total: wp.array4d(dtype=wp.float64),  # shape [worlds, rows, group_count, k]
    ):
        block = wp.tid() / wp.block_dim()
        k = block % each.shape[1]
        g = block / each.shape[1] % (first.shape[0] - 1)
        w = block / each.shape[1] / (first.shape[0] - 1)
        own = wp.float64(0.0)
        n = first[g] + wp.tid() % wp.block_dim()
        while n < first[g + 1]:
            e = w * count + entry[n]
            own += wp.float64(each[e, k])
            each[e, k] = scalar(0.0)
            n += wp.block_dim()
        whole = wp.tile_extract(wp.tile_sum(wp.tile(own)), 0)
        if wp.tid() % wp.block_dim() == 0:
            total[w, row, g, k] = total[w, row, g, k] + whole

    return sum_groups
