"""Device data of contact between bodies: surfaces, rules, neighbor list and history; and of near pairs."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import compensated_sum
from ..effect import ForceTerm
from ..records import table

MOVED, WAY, LONGEST_ROW, MOST_BODY_PAIRS, DEEPEST, HELD_BACK, PAIRS, ACTIVE = range(8)
"""Indices of flags: longest path of a vertex since the last search [m], and in a substep; longest row; most bodies
near one body; deepest overlap [m]; furthest that a particle was held back in a substep [m]; and of all worlds, in
the first world's flags, near pairs, and points with facets near them."""
FLAGS = 8
STORED = 2
"""Bodies near a point whose nearest facets are stored, where contacts are counted first."""
NOT_DUE, DUE, FORCED = range(3)
"""Whether lists must be made: no; yes, since vertices have moved far; yes, since positions were changed."""
HISTORY = 2
"""Number of bodies that a point can stick to at a time; along others it only slides."""


@functools.cache
def Pair(scalar: type):
    """Compose the struct of the body of a point and a body that the point may touch."""

    @wp.struct
    class Pair:
        mine: int  # body of the point
        other: int  # body of the facets
        place: int  # in the row of body_pairs
        closed: int  # whether the other body is another one that has an inside
        reach: scalar  # largest distance at which a facet pushes the point [m]
        thickness: scalar  # distance at which contact begins [m]
        stiffness: scalar  # of one point [N/m]
        density: scalar  # vertices per point of the point's body
        damping: scalar  # damping ratio
        friction: scalar

    return Pair


@functools.cache
def BodyContactData(scalar: type, worlds: bool = False):
    """Compose the struct of contact between bodies. Four owners on the host fill its parts.

    A vertex is a weighted mean of particles; points and facets are made of vertices. A point is a vertex (both of
    its ends are the same) or lies on an edge. A facet is a triangle, for a rope a segment, for a grain a point.
    In an ensemble (`worlds`) the bodies of all worlds are concatenated, as are vertices, points and facets.
    """
    V, Side, PointAndBody = vector(3, scalar), wp.types.vector(4, scalar), Pair(scalar)

    @wp.struct
    class ContactSurfaces:
        # Vertices; x and v are in records, and are recomputed before each evaluation of forces:
        first: wp.array(dtype=int)  # row starts of particle and weight, shape [vertex_count + 1]
        particle: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # of each particle, shape [any]
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg], shape [vertex_count]
        first_near: wp.array(dtype=int)  # row starts of near, shape [vertex_count + 1]
        near: wp.array(dtype=int)  # vertices of the same body that it never touches, shape [any]
        first_facet: wp.array(dtype=int)  # row starts of facet, shape [vertex_count + 1]
        facet: wp.array(dtype=int)  # triangles around the vertex, shape [any]
        body_of: wp.array(dtype=int)  # its body
        x: wp.array(dtype=V)  # position [m]
        v: wp.array(dtype=V)  # velocity [m/s]
        force: wp.array2d(dtype=wp.int64)  # on the vertex, in units, shape [vertex_count, 3]
        # Particles, if dampers are limited, see `damping_limits`:
        touches: wp.array(dtype=int)  # in how many contacts it is now, shape [particle_count]
        inverse_mass: wp.array(dtype=scalar)  # [1/kg], shape [particle_count]
        damping_limit: wp.array(dtype=scalar)  # of each world [1/s]
        # Points:
        ends: wp.array(dtype=wp.vec2i)  # its two vertices, shape [point_count]
        share: wp.array(dtype=scalar)  # weight of the second vertex
        body: wp.array(dtype=int)  # its body
        # Facets:
        corner: wp.array(dtype=wp.vec3i)  # its three vertices, shape [facet_count]
        owner: wp.array(dtype=int)  # its body
        # Bodies:
        closed: wp.array(dtype=int)  # whether its surface has an inside, shape [body_count]
        depth: wp.array(dtype=scalar)  # deepest point that is still pushed out [m]
        stiffness: wp.array(dtype=scalar)  # of a contact with an equal body [N/m]
        density: wp.array(dtype=scalar)  # vertices per point: a point has this share of the stiffness
        radius: wp.array(dtype=scalar)  # half of its thickness [m]
        if worlds:
            bodies_each: int  # bodies of a world
            unit: wp.array(dtype=wp.float64)  # of the forces in each world [N], shape [world_count]

    @wp.struct
    class ContactRules:
        kind: wp.array(dtype=int)  # of each body, shape [body_count]
        table: wp.array2d(dtype=int)  # rule for two kinds of bodies; −1: no contact
        # By rule:
        self_contact: wp.array(dtype=int)  # whether a body touches itself
        friction: wp.array(dtype=scalar)
        damping: wp.array(dtype=scalar)  # damping ratio of a contact, from its restitution
        thickness: wp.array(dtype=scalar)  # [m]; below 0: as each body has
        stiffness: wp.array(dtype=scalar)  # [N/m]; below 0: as each body has

    @wp.struct
    class NeighborList:
        x_found: wp.array(dtype=V)  # positions of vertices at the last search [m], in records
        since: wp.array(dtype=float)  # time from it to the end of the last substep [s], shape [1]
        due: wp.array(dtype=int)  # whether lists are invalid: NOT_DUE, DUE or FORCED, shape [1]
        # Rows of facets near points:
        candidates: wp.array2d(dtype=int)  # facets, grouped by body, shape [point_count, room]
        candidate_pair: wp.array2d(dtype=int)  # its body, as an index in the row of body_pairs
        candidate_distance: wp.array2d(dtype=scalar)  # distance at the last search [m]
        candidate_count: wp.array(dtype=int)  # length of each row
        # Points:
        in_order: wp.array(dtype=int)  # points in an order that keeps near points together
        near_own: wp.array(dtype=int)  # whether it may touch its own body, if that is open
        search_points: wp.array(dtype=int)  # points to search rows for, in any order
        search_point_count: wp.array(dtype=int)  # number of search_points, shape [1]
        active_points: wp.array(dtype=int)  # points that have a row, or overlap since the start, in any order
        active_count: wp.array(dtype=int)  # number of active_points, shape [1]
        speeds: wp.array(dtype=wp.vec3)  # of active points by axis: max v and max −v [m/s], shape [2]
        # Bodies:
        body_pairs: wp.array2d(dtype=int)  # bodies that may touch each now, in any order, shape [body_count, room]
        pairs: wp.array2d(dtype=PointAndBody)  # the numbers of each such pair
        body_pair_count: wp.array(dtype=int)  # length of each row
        if worlds:
            root_of_world: wp.array(dtype=int)  # root of each world's subtree in the tree of bodies

    @wp.struct
    class FoundContacts:
        # If dampers are limited, what `count_contacts` has found for the first bodies in each row:
        facet: wp.array2d(dtype=int)  # the nearest facet, shape [STORED, point_count]
        until: wp.array2d(dtype=int)  # end of the body's facets in the row
        weights: wp.array2d(dtype=V)  # of its corners at the nearest point
        side: wp.array2d(dtype=Side)  # unit normal, and gap [m], FAR if out of reach

    @wp.struct
    class ContactHistory:
        tangential_displacement: wp.array2d(dtype=V)  # along contact_body [m], shape [HISTORY, point_count]
        contact_body: wp.array2d(dtype=int)  # body that the point touches, −1: none
        initial_overlap: wp.array(dtype=scalar)  # overlap at the start that is still allowed [m]
        overlap_release_speed: scalar  # rate at which initial_overlap shrinks [m/s]
        done: wp.array(dtype=wp.float64)  # work of depenetration [J]

    @wp.struct
    class BodyContactData:
        surfaces: ContactSurfaces
        rules: ContactRules
        neighbors: NeighborList
        contacts: FoundContacts
        history: ContactHistory

    return BodyContactData


@functools.cache
def InnerSurfaces(scalar: type):
    """Compose the struct of inner surfaces, which lie inside closed bodies.

    Closed bodies may overlap, but not cross each other's inner surfaces. Each vertex of one lies on the chord from
    a drawn vertex to the opposite side of its body.
    """
    V, W = vector(3, scalar), wp.types.vector(4, scalar)

    @wp.struct
    class InnerSurfaces:
        chord: wp.array(dtype=wp.vec4i)  # the drawn vertex and those of the opposite facet; −1: none
        weight: wp.array(dtype=W)  # theirs
        x: wp.array(dtype=V)  # positions at the last search [m], in records
        inset: wp.array(dtype=float)  # of each body: largest distance of one of them from the drawn one then [m]
        more: wp.array(dtype=scalar)  # by this much more than half a skin may one of its vertices move [m]

    return InnerSurfaces


@functools.cache
def NearPairs(scalar: type):
    """Compose the struct of near pairs, and of the impulses and shortened displacements that keep them apart."""
    V, W, Inner = vector(3, scalar), wp.types.vector(4, scalar), InnerSurfaces(scalar)

    @wp.struct
    class NearPairs:
        # Vertices: first those that are drawn, then those of inner surfaces:
        first_particle: wp.array(dtype=int)  # row starts of particle_of and weight
        particle_of: wp.array(dtype=int)
        weight: wp.array(dtype=scalar)  # of each particle
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg]
        body_of: wp.array(dtype=int)
        inner: Inner
        # Edges; a grain is an edge whose ends are the same:
        edge: wp.array(dtype=wp.vec2i)  # the ends of each, shape [edge_count]
        rank: wp.array(dtype=int)  # of each body by the length of its edges, the shortest first
        # Facets:
        owned: wp.array(dtype=int)  # its corners (bits 0 to 2) and sides (3 to 5) that belong to no other facet
        points: wp.array(dtype=int)  # six each: in owned corners, in the middle of owned sides; below 0: none
        queue: wp.array(dtype=wp.vec3i)  # two facets that may be near, and a test; QUEUES for each warp
        # Pairs:
        vertices: wp.array(dtype=wp.vec4i)  # a vertex and a triangle; or the ends of two edges, the first end as ~
        count: wp.array(dtype=int)  # number of pairs, shape [1]
        weights: wp.array(dtype=W)  # of the vertices in the shortest line from the second side to the first
        normal: wp.array(dtype=V)  # of the plane between the two sides, towards the first
        gap: wp.array(dtype=scalar)  # from the second side to the first along it [m], at most 0 where they cross
        least: wp.array(dtype=scalar)  # the least that may be left on either side of the plane [m]
        reserve: wp.array(dtype=scalar)  # how much more the sides may approach before anything must be done [m]
        watched: wp.array(dtype=int)  # the pairs that may come too near in this substep, in any order
        watched_count: wp.array(dtype=int)  # number of them, shape [1]
        pushing: wp.array(dtype=int)  # the pairs that come too near in a round, in any order
        pushing_count: wp.array(dtype=int)  # number of them, shape [1]
        # Particles:
        in_pair: wp.array(dtype=int)  # whether each is in a pair, shape [particle_count]
        particle: wp.array(dtype=int)  # the particles in pairs, in any order
        particle_count: wp.array(dtype=int)  # number of particles in pairs, shape [1]
        inverse_mass: wp.array(dtype=scalar)  # [1/kg], of the particles of all worlds
        pushes: wp.array(dtype=int)  # pairs that push each particle in a round
        impulse: wp.array2d(dtype=wp.int64)  # of pairs on each particle, times the substep [kg m], in units
        share: wp.array(dtype=float)  # of its displacement in the substep that each particle may make
        held: wp.array(dtype=int)  # whether that is less than all, as of an earlier round
        body: wp.array(dtype=int)  # its body
        shift: wp.array(dtype=float)  # length of its path by impulses in this substep [m]
        most_shift: wp.array(dtype=float)  # the longest such path in each body [m]
        foreseen: wp.array(dtype=float)  # the longest path for which pairs of each body are watched [m]
        most_weight: float  # largest sum of the absolute weights of a vertex
        driven: wp.array(dtype=int)  # indices of the driven particles
        done: wp.array(dtype=wp.float64)  # work of driven particles on others [J]; empty if none is driven
        contact_impulse: wp.array(dtype=wp.vec3d)  # on each particle [N s]; empty if not asked for
        # Rules, see `ContactRules`:
        kind: wp.array(dtype=int)
        rules: wp.array2d(dtype=int)
        friction: wp.array(dtype=scalar)
        restitution: wp.array(dtype=scalar)
        # Results:
        tangles: wp.array(dtype=int)  # whether any edge crosses a triangle, shape [1]
        tangled: wp.array(dtype=int)  # whether `find_tangles` has marked each vertex
        may_meet: wp.array(dtype=int)  # whether inner surfaces may meet in this substep, shape [1]
        alarm: wp.array(dtype=int)  # whether a pair comes too near in this substep, shape [1]
        many: wp.array(dtype=int)  # whether there are then too many pairs for a single launch, shape [1]
        exceeded: wp.array(dtype=int)  # whether a path is longer than foreseen in this substep, shape [1]
        lacking: wp.array(dtype=int)  # last round of impulses in which a pair came too near, from 1
        cutting: wp.array(dtype=int)  # whether any displacement is shortened in this substep, shape [1]
        unsettled: wp.array(dtype=int)  # of each world: whether the last round but one held particles back

    return NearPairs


@functools.cache
def Substep(scalar: type):
    """Compose the struct of the numbers that kernels over contact points need of the current substep."""

    @wp.struct
    class Substep:
        h: scalar  # length of the coming substep [s]; 0 for measurements, which change no history
        behind: scalar  # twice the time by which velocities lag behind positions [s]
        per_unit: wp.float64  # units of force per newton [1/N]; in an ensemble each world has its own
        buffer: scalar  # bound on how much distances have shrunk since the last search [m]
        parts: int  # number of parts for threads of the CPU

    return Substep


@functools.cache
def first_flag(scalar: type, worlds: bool):
    """Compose (data, body) -> the index of the first flag of the body's world; each world has its own flags."""
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
    """Return the force term of contact between bodies: the vertices' forces, spread to their particles."""
    V, entry, weight_of = vector(dim, scalar), table(int), table(scalar)
    Compensation, _ = compensated_sum(dim, scalar, compensated)

    @wp.struct
    class VertexForces:
        first: wp.array(dtype=int)  # row starts of vertex and weight, shape [particle_count + 1]
        vertex: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # of the particle in each vertex, shape [any]
        force: wp.array2d(dtype=wp.int64)  # on vertices, in units, shape [vertex_count, 3]
        unit: wp.float64  # [N]

    def force(SceneData: Any):
        @wp.func
        def push(
            scene: SceneData, compensation: Compensation, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int
        ) -> V:
            total = V()
            for s in range(entry(scene.body_contact.first, i), entry(scene.body_contact.first, i + 1)):
                vertex = entry(scene.body_contact.vertex, s)
                for k in range(wp.static(dim)):
                    f = wp.float64(scene.body_contact.force[vertex, k]) * scene.body_contact.unit
                    total[k] = total[k] + weight_of(scene.body_contact.weight, s) * scalar(f)
            return total

        return push

    return ForceTerm("body_contact", VertexForces, force=force, selective=True)
