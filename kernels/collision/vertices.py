"""Vertices of surfaces, from their particles; also the facets that have torn."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..compensation import compensated_sum
from ..partition import first_of_part, next_of_part, raise_to
from ..records import records, table
from ..threads import grid_thread
from .contact_data import DUE, FORCED, MOVED, NEAR_PATH, PATH, BodyContactData, NearPairs, first_flag
from .facet_tree import drifts

FURTHER = 1.25
"""Slack of a vertex that has left its slack, over the path that it has made."""


@functools.cache
def place_vertices(dim: int, scalar: type, compensated: bool, worlds: bool = False):
    """Compose the kernel that updates vertices from their particles and clears their forces and contacts.

    It also measures how far vertices have moved since the last search, less the common drift of points in contact,
    and how far they move in a substep. A new search is due if a vertex has moved by more than its slack, or may do
    so in the coming substep. If a substep begins, the sums of touching points begin anew (`pairs.crowding`).
    The threads divide the vertices. On the CPU each part has a single thread, since each thread would copy `data`.
    """
    V, Data = vector(dim, scalar), BodyContactData(scalar)
    Compensation, _ = compensated_sum(dim, scalar, compensated)
    (load, store, _), first_of = records(dim, scalar), first_flag(scalar, worlds)
    entry, weight_of, drift_of = table(int), table(scalar), drifts(scalar)

    @kernel
    def place(
        data: Data,
        compensation: Compensation,
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        after: float,  # time from the end of the last substep [s]
        h: float,  # length of a substep [s]
        ahead: float,  # how long the lists must stay valid [s]
        buffer: wp.array(dtype=scalar),  # [m], shape [1]
        beyond: float,  # a vertex that has moved further belongs to a diverging body [m]
        begins: int,  # whether a substep begins
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
        flags: wp.array(dtype=float),
    ):
        i = first_of_part(grid_thread(), part)
        drift = drift_of(data)
        since = data.neighbors.since[0] + after
        skin = float(buffer[0])
        while i < data.surfaces.x.shape[0]:
            place = V()
            speed = V()
            for s in range(entry(data.surfaces.first, i), entry(data.surfaces.first, i + 1)):
                j = entry(data.surfaces.particle, s)
                x_j = load(x, j)
                if wp.static(compensated):
                    x_j = x_j - load(compensation.x, j)
                place += weight_of(data.surfaces.weight, s) * x_j
                speed += weight_of(data.surfaces.weight, s) * load(v, j)
            store(data.surfaces.x, i, place)
            store(data.surfaces.v, i, speed)
            for k in range(wp.static(dim)):
                data.surfaces.force[i, k] = wp.int64(0)
            if begins != 0:
                data.surfaces.touching[i, 1] = data.surfaces.touching[i, 0]
                data.surfaces.touching[i, 0] = wp.int64(0)
            x_found = load(data.neighbors.x_found, i)
            moved = wp.length(wp.vec3(place - x_found) - since * drift)
            fast = wp.length(wp.vec3(speed) - drift)
            body = entry(data.surfaces.body_of, i)
            if not (moved <= data.neighbors.moved[body]):
                raise_to(data.neighbors.moved, body, moved)
            at = first_of(data, body)
            if not (h * fast <= flags[at + wp.static(PATH)]):
                raise_to(flags, at + wp.static(PATH), h * fast)
            near = data.neighbors.body_pair_count[body] > 0
            if near and not (h * fast <= flags[at + wp.static(NEAR_PATH)]):
                raise_to(flags, at + wp.static(NEAR_PATH), h * fast)
            if data.neighbors.due[0] != wp.static(FORCED):
                slack = data.neighbors.slack[i] + data.neighbors.spare[body]
                beside = moved - slack + 0.5 * skin
                if not (beside <= flags[at + wp.static(MOVED)]):
                    raise_to(flags, at + wp.static(MOVED), beside)
                if moved > slack:
                    n = data.neighbors.started[0]
                    data.neighbors.overrun[n, i] = wp.max(data.neighbors.overrun[n, i], wp.static(FURTHER) * moved)
                if moved + ahead * fast > slack and moved < beyond:
                    data.neighbors.due[0] = wp.static(DUE)
            i = next_of_part(i, threads, parts)

    return place


@wp.struct
class TearingFacets:
    """The springs along the sides of facets and at contact points that may tear, and the untorn facets."""

    broken_at: wp.array(dtype=wp.float32)  # time of breaking of each spring [s], inf if unbroken
    # Facets, shape [facet_count]:
    spring: wp.array2d(dtype=int)  # along its three sides, below 0: none, shape [facet_count, 3]
    least: wp.array(dtype=int)  # the facet has torn if so many of them are broken
    corner: wp.array(dtype=wp.vec3i)
    part: wp.array2d(dtype=int)  # its corners and sides, see `parts_of_facets`, shape [facet_count, 6]
    first: wp.array(dtype=int)  # row starts of around, by parts, shape [part_count + 1]
    around: wp.array(dtype=int)  # the facets that share a part, in order, shape [any]
    # Points, shape [point_count]:
    along: wp.array(dtype=int)  # the spring that it lies on, below 0: none
    fraction: wp.array(dtype=wp.float64)


@functools.cache
def leave_out_torn(scalar: type):
    """Compose the kernel that turns torn facets into grains, and points on broken springs into vertices.

    A torn facet remains as its first corner only, a point as its first end. The first facet around a corner or
    side that has not torn owns it, a grain its corner if all have torn. If any facet changes, a new search is due.
    The threads divide the facets and the points.
    """
    Data, Pairs = BodyContactData(scalar), NearPairs(scalar)

    @wp.func
    def is_broken(tearing: TearingFacets, spring: int) -> bool:
        if spring < 0:
            return False
        return wp.isfinite(tearing.broken_at[spring])

    @wp.func
    def has_torn(tearing: TearingFacets, facet: int) -> bool:
        broken = int(0)
        for k in range(3):
            broken += int(is_broken(tearing, tearing.spring[facet, k]))
        return broken >= tearing.least[facet]

    @wp.func
    def owner_of(tearing: TearingFacets, part: int) -> int:
        """Return the first facet around a part that has not torn; -1 if all have."""
        for e in range(tearing.first[part], tearing.first[part + 1]):
            if not has_torn(tearing, tearing.around[e]):
                return tearing.around[e]
        return -1

    @kernel
    def leave_out(data: Data, pairs: Pairs, tearing: TearingFacets, threads: int, part: int, parts: int):
        i = first_of_part(grid_thread(), part)
        while i < tearing.corner.shape[0] or i < tearing.along.shape[0]:
            if i < tearing.corner.shape[0]:
                corner = tearing.corner[i]
                owned = int(0)
                if has_torn(tearing, i):
                    corner = wp.vec3i(corner[0], corner[0], corner[0])
                    if owner_of(tearing, tearing.part[i, 0]) < 0:
                        owned = 0b001001  # the first corner and side, as of a grain
                else:
                    for k in range(6):
                        if tearing.part[i, k] >= 0:
                            owned |= int(owner_of(tearing, tearing.part[i, k]) == i) << k
                pairs.owned[i] = owned
                if corner[1] != data.surfaces.corner[i][1]:
                    data.surfaces.corner[i] = corner
                    data.neighbors.due[0] = wp.static(FORCED)
            if i < tearing.along.shape[0]:
                data.surfaces.fraction[i] = scalar(tearing.fraction[i])
                if is_broken(tearing, tearing.along[i]):
                    data.surfaces.fraction[i] = scalar(0.0)
            i = next_of_part(i, threads, parts)

    return leave_out
