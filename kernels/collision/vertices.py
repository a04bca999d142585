"""Positions and velocities of surface vertices, from those of particles."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..compensation import compensated_sum
from ..records import records
from .contact_data import BodyContactData, first_flag
from .cpu_partition import first_of_part, next_of_part, raise_to


@functools.cache
def place_vertices(dim: int, scalar: type, compensated: bool, worlds: bool = False):
    """Compose the kernel that updates vertices from their particles and clears their forces and contacts.

    It also measures how far vertices have moved since the last search, beyond the common drift of points in
    contact: this decides whether neighbor lists are valid. Vertices far from other bodies may move further. Its
    threads share the vertices. On the CPU a part has a single thread, since each thread would copy `data`.
    """
    V, Data = vector(dim, scalar), BodyContactData(scalar, worlds)
    Compensation, _ = compensated_sum(dim, scalar, compensated)
    (load, store, _), first_of = records(dim, scalar), first_flag(scalar, worlds)

    @kernel
    def place(
        data: Data,
        compensation: Compensation,
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        since: float,  # time since the last search [s]
        buffer: wp.array(dtype=scalar),  # [m], shape [1]
        more: float,  # additional path allowed to distant vertices, both together [m]
        widest: wp.array(dtype=float),  # longest side of a facet's box, by body [m]
        least: wp.array(dtype=wp.vec3),  # box that holds all parts of a body near others, shape [body_count]
        most: wp.array(dtype=wp.vec3),
        listing: bool,  # whether a search follows
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
        way: wp.array(dtype=float),  # longest path of a vertex [m], at the first flag of its world
    ):
        i = first_of_part(wp.tid(), part)
        drift = (0.5 * since) * (data.neighbors.speeds[0] - data.neighbors.speeds[1])
        far = float(buffer[0]) / (float(buffer[0]) + more)
        while i < data.surfaces.x.shape[0]:
            place = V()
            speed = V()
            for s in range(data.surfaces.first[i], data.surfaces.first[i + 1]):
                j = data.surfaces.particle[s]
                x_j = load(x, j)
                if wp.static(compensated):
                    x_j = x_j - load(compensation.x, j)
                if data.surfaces.touches.shape[0] > 0:
                    data.surfaces.touches[j] = 0
                place += data.surfaces.weight[s] * x_j
                speed += data.surfaces.weight[s] * load(v, j)
            store(data.surfaces.x, i, place)
            store(data.surfaces.v, i, speed)
            for k in range(wp.static(dim)):
                data.surfaces.force[i, k] = wp.int64(0)
            x_found = load(data.neighbors.x_found, i)
            before = wp.vec3(x_found)
            moved = wp.length(wp.vec3(place - x_found) - drift)
            if listing:
                store(data.neighbors.x_found, i, place)
            # The box is widened so that no corner of a near facet counts as distant.
            body = data.surfaces.body_of[i]
            further = wp.vec3(1.0, 1.0, 1.0) * (more + widest[body])
            low = least[body] - further
            high = most[body] + further
            if not (wp.min(before, low) == low and wp.max(before, high) == high):
                moved *= far
            at = first_of(data, body)
            if not (moved <= way[at]):
                raise_to(way, at, moved)
            i = next_of_part(i, threads, parts)

    return place
