"""What touches, on a device: vertices, points, facets, and what has been found of them."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import compensated_sum
from ..effect import ForceTerm

MOVED, WAY, LONGEST_ROW, MOST_BODY_PAIRS, DEEPEST = range(5)
"""Flags: the furthest way of a vertex since rows were found [m], and from one search to the next; the longest row;
the most bodies beside one; the deepest overlap [m]."""
FLAGS = 5
HISTORY = 2
"""Bodies with which a point may stick at a time; with more it only slides."""


@functools.cache
def Surfaces(scalar: type, worlds: bool = False):
    """Compose the struct of the surfaces that may touch.

    Vertices are mixtures of particles; points and facets are made of vertices. A point is a vertex (both of its
    vertices are the same) or lies on an edge. A facet is a triangle, of a rope a segment, of a grain a point.
    In an ensemble (`worlds`) those of all worlds follow each other, as bodies do: a world's are numbered by what
    comes before it.
    """
    V = vector(3, scalar)

    class ContactSurfacesStruct:
        # Vertices:
        first: wp.array(dtype=int)  # where the particles of each begin, shape [vertex_count + 1]
        particle: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # the share of each, shape [any]
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg], shape [vertex_count]
        first_near: wp.array(dtype=int)  # where the vertices of its own body that it never touches begin
        near: wp.array(dtype=int)  # these, shape [any]
        body_of: wp.array(dtype=int)  # its body
        x: wp.array(dtype=V)  # where it is [m]; in records, as `v` and `x_found` are
        v: wp.array(dtype=V)  # how fast [m/s]
        x_found: wp.array(dtype=V)  # where it was as rows were found [m]
        force: wp.array2d(dtype=wp.int64)  # on it, in units, shape [vertex_count, 3]
        # Points:
        ends: wp.array(dtype=wp.vec2i)  # the two vertices of each, shape [point_count]
        share: wp.array(dtype=scalar)  # that of the second one
        body: wp.array(dtype=int)  # its body
        candidates: wp.array2d(dtype=int)  # facets near it, by bodies, in any order, shape [point_count, room]
        candidate_body: wp.array2d(dtype=int)  # the body of each
        candidate_distance: wp.array2d(dtype=scalar)  # how far off each was as it was found [m]
        candidate_count: wp.array(dtype=int)  # how many
        in_order: wp.array(dtype=int)  # points, so that those near each other follow each other
        search_points: wp.array(dtype=int)  # points that rows are looked for, in any order
        search_point_count: wp.array(dtype=int)  # how many these are, shape [1]
        active_points: wp.array(dtype=int)  # the points that have any, or overlap since the start, in any order
        active_count: wp.array(dtype=int)  # how many these are, shape [1]
        speeds: wp.array(dtype=wp.vec3)  # the highest of theirs by axis, and less the lowest [m/s], shape [2]
        tangential_displacement: wp.array2d(
            dtype=V
        )  # how far it was moved along what it sticks to [m], shape [HISTORY, any]
        contact_body: wp.array2d(dtype=int)  # which body that is, −1: none
        contact_side: wp.array2d(
            dtype=int
        )  # 1 + the facet of it on whose side the point is, negative from behind; or 0
        initial_overlap: wp.array(dtype=scalar)  # by how much it may still overlap, since it did at the start [m]
        overlap_release_speed: scalar  # how fast that shrinks [m/s]
        done: wp.array(dtype=wp.float64)  # the work of what shrinks it [J]
        overrun: wp.array(dtype=wp.float64)  # the first contact that may end on the wrong side; see `overrun`
        # Facets:
        corner: wp.array(dtype=wp.vec3i)  # the vertices of each, shape [facet_count]
        owner: wp.array(dtype=int)  # its body
        # Bodies:
        body_pairs: wp.array2d(dtype=int)  # which may touch each now, in any order, shape [body_count, room]
        body_pair_count: wp.array(dtype=int)  # how many
        root: wp.array(dtype=int)  # where in the tree of facets those of each are
        kind: wp.array(dtype=int)  # which rules hold for it, shape [body_count]
        closed: wp.array(dtype=int)  # whether its surface has an inside
        sided: wp.array(dtype=int)  # whether it is a sheet on whose sides points of other bodies stay
        depth: wp.array(dtype=scalar)  # how deep a point may be in it, or behind it, and still be pushed out [m]
        stiffness: wp.array(dtype=scalar)  # of a contact with a body alike [N/m]
        density: wp.array(dtype=scalar)  # vertices by points: a point has this share of the stiffness
        radius: wp.array(dtype=scalar)  # half of its thickness [m]
        # Rules, by the kinds of both bodies, shape [kind_count, kind_count]:
        rule: wp.array2d(dtype=int)  # −1: they pass through each other
        among: wp.array(dtype=int)  # by rule, as all below: whether a body touches itself
        friction: wp.array(dtype=scalar)
        damping: wp.array(dtype=scalar)  # damping ratio of a contact, from its restitution
        thickness: wp.array(dtype=scalar)  # [m], below 0: of each body its own
        given: wp.array(dtype=scalar)  # stiffness [N/m], below 0: of each body its own

    if worlds:
        ContactSurfacesStruct.__annotations__ |= {
            "bodies_each": int,  # bodies of a world
            "unit": wp.array(dtype=wp.float64),  # of the forces in each [N], shape [world_count]
            "root_of_world": wp.array(dtype=int),  # where in the tree of bodies those of each are
        }
    return wp.struct(ContactSurfacesStruct)


@functools.cache
def first_flag(scalar: type, worlds: bool):
    """Compose (data, body) -> where the flags of a body's world begin: each world has its own."""
    Data = Surfaces(scalar, worlds)

    @wp.func
    def first_of(data: Data, body: int) -> int:
        at = int(0)
        if wp.static(worlds):
            at = wp.static(FLAGS) * (body / data.bodies_each)
        return at

    return first_of


@functools.cache
def body_contact_term(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return what contact between bodies adds to kernels: the forces of the vertices on their particles."""
    V = vector(dim, scalar)
    Compensation, _ = compensated_sum(dim, scalar, compensated)

    @wp.struct
    class Touched:
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

    return ForceTerm("body_contact", Touched, force=force, selective=True)
