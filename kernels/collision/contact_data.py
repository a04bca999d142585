"""Contact between bodies, on a device: their surfaces, the rules, the lists of neighbours and the history."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import compensated_sum
from ..effect import ForceTerm

MOVED, WAY, LONGEST_ROW, MOST_BODY_PAIRS, DEEPEST, PAIRS, HELD_BACK = range(7)
"""Flags: the furthest way of a vertex since rows were found [m], and from one search to the next; the longest row;
the most bodies near one; the deepest overlap [m]; near pairs, of all worlds, in the first one's flags; and the
furthest that a particle was held back in a substep [m]."""
FLAGS = 7
HISTORY = 2
"""Bodies that a point may stick to at a time; along others it only slides."""


@functools.cache
def BodyContactData(scalar: type, worlds: bool = False):
    """Compose the struct of contact between bodies. Its four parts are filled by the four owners on the host.

    A vertex is a mixture of particles; points and facets are made of vertices. A point is a vertex (both of its
    ends are the same) or lies on an edge. A facet is a triangle, of a rope a segment, of a grain a point.
    In an ensemble (`worlds`) the bodies of all worlds follow each other, and so do their vertices, points and
    facets.
    """
    V = vector(3, scalar)

    @wp.struct
    class ContactSurfaces:
        # Vertices; records hold x and v, which are found again wherever forces are taken:
        first: wp.array(dtype=int)  # where the particles of each begin, shape [vertex_count + 1]
        particle: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # the share of each, shape [any]
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg], shape [vertex_count]
        first_near: wp.array(dtype=int)  # where the vertices of its own body that it never touches begin
        near: wp.array(dtype=int)  # these, shape [any]
        body_of: wp.array(dtype=int)  # its body
        x: wp.array(dtype=V)  # position [m]
        v: wp.array(dtype=V)  # velocity [m/s]
        force: wp.array2d(dtype=wp.int64)  # on it, in units, shape [vertex_count, 3]
        # Points:
        ends: wp.array(dtype=wp.vec2i)  # the two vertices of each, shape [point_count]
        share: wp.array(dtype=scalar)  # that of the second one
        body: wp.array(dtype=int)  # its body
        # Facets:
        corner: wp.array(dtype=wp.vec3i)  # the vertices of each, shape [facet_count]
        owner: wp.array(dtype=int)  # its body
        # Bodies:
        closed: wp.array(dtype=int)  # whether the surface of each has an inside, shape [body_count]
        depth: wp.array(dtype=scalar)  # how deep a point may be in it and still be pushed out [m]
        stiffness: wp.array(dtype=scalar)  # of a contact with a body alike [N/m]
        density: wp.array(dtype=scalar)  # vertices by points: a point has this share of the stiffness
        radius: wp.array(dtype=scalar)  # half of its thickness [m]
        if worlds:
            bodies_each: int  # bodies of a world
            unit: wp.array(dtype=wp.float64)  # of the forces in each world [N], shape [world_count]

    @wp.struct
    class ContactRules:
        kind: wp.array(dtype=int)  # of each body, shape [body_count]
        table: wp.array2d(dtype=int)  # the rule by the kinds of both bodies; −1: they pass through each other
        # By rule:
        self_contact: wp.array(dtype=int)  # whether a body touches itself
        friction: wp.array(dtype=scalar)
        damping: wp.array(dtype=scalar)  # damping ratio of a contact, from its restitution
        thickness: wp.array(dtype=scalar)  # [m], below 0: of each body its own
        stiffness: wp.array(dtype=scalar)  # [N/m], below 0: of each body its own

    @wp.struct
    class NeighborList:
        x_found: wp.array(dtype=V)  # where vertices were as rows were found [m], in records
        # Rows of facets near points:
        candidates: wp.array2d(dtype=int)  # facets by bodies, in any order, shape [point_count, room]
        candidate_body: wp.array2d(dtype=int)  # the body of each
        candidate_distance: wp.array2d(dtype=scalar)  # how far off each was as it was found [m]
        candidate_count: wp.array(dtype=int)  # how many
        # Points:
        in_order: wp.array(dtype=int)  # points, so that those near each other follow each other
        search_points: wp.array(dtype=int)  # points that rows are looked for, in any order
        search_point_count: wp.array(dtype=int)  # how many these are, shape [1]
        active_points: wp.array(dtype=int)  # the points that have a row, or overlap since the start, in any order
        active_count: wp.array(dtype=int)  # how many these are, shape [1]
        speeds: wp.array(dtype=wp.vec3)  # the highest of theirs by axis, and less the lowest [m/s], shape [2]
        # Bodies:
        body_pairs: wp.array2d(dtype=int)  # which may touch each now, in any order, shape [body_count, room]
        body_pair_count: wp.array(dtype=int)  # how many
        root: wp.array(dtype=int)  # where the facets of each begin in the tree of facets
        if worlds:
            root_of_world: wp.array(dtype=int)  # where the bodies of each world begin in the tree of bodies

    @wp.struct
    class ContactHistory:
        tangential_displacement: wp.array2d(
            dtype=V
        )  # along what each point touches [m], shape [HISTORY, point_count]
        contact_body: wp.array2d(dtype=int)  # which body that is, −1: none
        initial_overlap: wp.array(dtype=scalar)  # how deep it may still be, since it was at the start [m]
        overlap_release_speed: scalar  # how fast that shrinks [m/s]
        done: wp.array(dtype=wp.float64)  # work of depenetration [J]

    @wp.struct
    class BodyContactData:
        surfaces: ContactSurfaces
        rules: ContactRules
        neighbors: NeighborList
        history: ContactHistory
        tunnelling: wp.array(dtype=wp.float64)  # the first contact that may end on the wrong side; see there

    return BodyContactData


@functools.cache
def Substep(scalar: type):
    """Compose the struct of the arguments of a launch over points."""

    @wp.struct
    class Substep:
        h: scalar  # length of the substep that begins [s]; 0 where none does, and nothing may slip further
        behind: scalar  # twice the time by which velocities lag behind positions [s]
        per_unit: wp.float64  # of forces [1/N]; of worlds each has its own
        buffer: scalar  # by how much distances may have become less since rows were found [m]
        parts: int  # that threads of the CPU take

    return Substep


@functools.cache
def first_flag(scalar: type, worlds: bool):
    """Compose (data, body) -> where the flags of a body's world begin: each world has its own."""
    Data = BodyContactData(scalar, worlds)

    @wp.func
    def first_of(data: Data, body: int) -> int:
        at = int(0)
        if wp.static(worlds):
            at = wp.static(FLAGS) * (body / data.surfaces.bodies_each)
        return at

    return first_of


@functools.cache
def body_contact_term(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the term of contact between bodies: the forces of the vertices on their particles."""
    V = vector(dim, scalar)
    Compensation, _ = compensated_sum(dim, scalar, compensated)

    @wp.struct
    class VertexForces:
        first: wp.array(dtype=int)  # where the vertices of each particle begin, shape [particle_count + 1]
        vertex: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # its share in each, shape [any]
        force: wp.array2d(dtype=wp.int64)  # on vertices, in units, shape [vertex_count, 3]
        unit: wp.float64  # [N]

    def force(SceneData: Any):
        @wp.func
        def push(
            scene: SceneData, compensation: Compensation, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int
        ) -> V:
            total = V()
            for s in range(scene.body_contact.first[i], scene.body_contact.first[i + 1]):
                vertex = scene.body_contact.vertex[s]
                for k in range(wp.static(dim)):
                    f = wp.float64(scene.body_contact.force[vertex, k]) * scene.body_contact.unit
                    total[k] = total[k] + scene.body_contact.weight[s] * scalar(f)
            return total

        return push

    return ForceTerm("body_contact", VertexForces, force=force, selective=True)
