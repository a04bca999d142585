"""Device data of contact between bodies: surfaces, rules, neighbor list, history and near pairs."""

import functools

import warp as wp

from ..basis import vector
from ..effect import ForceTerm, instant
from ..records import table

MOVED, PATH, NEAR_PATH, LONGEST_ROW, MOST_BODY_PAIRS, DEEPEST, HELD_BACK, PAIRS, ACTIVE, NEAR_FACETS = range(10)
"""Indices of flags: longest path of a vertex since the last search, less what it may move beyond half of the skin
[m]; longest path in a substep, of all vertices and of those of bodies near others; longest row; most bodies near
one body; deepest overlap [m]; largest displacement that was prevented in a substep [m]. The first world also has,
for all worlds, the numbers of near pairs, of points with facets near them, and of facets near each other, or
tests of them, for which there was no room."""
FLAGS = 10
NOT_DUE, DUE, FORCED = range(3)
"""Whether lists must be made: no; yes, since vertices have moved far; yes, since positions were changed."""
WHOLE = 1024.0
"""Unit of the sums of densities of points, which are integers so that their order does not matter."""
HISTORY = 2
"""Number of bodies that a point can stick to at a time; along others it only slides."""


@functools.cache
def Pair(scalar: type):
    """Compose the struct of constants for contact of the points of one body with the facets of another."""

    @wp.struct
    class Pair:
        mine: int  # body of the point
        other: int  # body of the facets
        place: int  # index of the other body in the row of body_pairs
        thickness: scalar  # distance at which contact begins [m]
        stiffness: scalar  # of the contact of one vertex [N/m]
        damping: scalar  # damping ratio of friction
        hysteresis: scalar  # see `contact_law`
        crowd: scalar  # points of the point's body for each vertex of the other one, at least 1
        friction: scalar

    return Pair


@functools.cache
def BodyContactData(scalar: type):
    """Compose the struct of contact between bodies. Four host classes fill its parts.

    A vertex is a weighted mean of particles. A contact point is a vertex (its two ends are the same) or lies on an
    edge between two vertices. A facet is a triangle, or a segment of a rope, or a grain, which is one particle. In
    an ensemble the bodies of all worlds are concatenated, as are vertices, points and facets.
    """
    V, PointAndBody = vector(3, scalar), Pair(scalar)

    @wp.struct
    class ContactSurfaces:
        # Vertices; x and v are stored as `records`, and recomputed before each evaluation of forces:
        first: wp.array(dtype=int)  # row starts of particle and weight, shape [vertex_count + 1]
        particle: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # of each particle, shape [any]
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg], shape [vertex_count]
        first_near: wp.array(dtype=int)  # row starts of near, shape [vertex_count + 1]
        near: wp.array(dtype=int)  # vertices of the same body that it never touches, shape [any]
        body_of: wp.array(dtype=int)  # its body
        tangled: wp.array(dtype=int)  # whether its surface has crossed another since the start
        x: wp.array(dtype=V)  # position [m]
        v: wp.array(dtype=V)  # velocity [m/s]
        force: wp.array2d(dtype=wp.int64)  # on the vertex, in units, shape [vertex_count, 3]
        # Density at the vertex of the points that touch, in this substep and in the last, in parts of WHOLE:
        touching: wp.array2d(dtype=wp.int64)  # shape [vertex_count, 2]
        inverse_mass: wp.array(dtype=scalar)  # of particles [1/kg], shape [particle_count]
        # Points:
        ends: wp.array(dtype=wp.vec2i)  # its two vertices, shape [point_count]
        fraction: wp.array(dtype=scalar)  # how far it is from the first to the second: the weight of the second
        body: wp.array(dtype=int)  # its body
        density: wp.array(dtype=scalar)  # of the stiffness of a vertex, by its area
        crowd: wp.array(dtype=scalar)  # sum of the densities of all points around it
        host: wp.array(dtype=int)  # a triangle that it lies on; below 0: none
        # Facets:
        corner: wp.array(dtype=wp.vec3i)  # its three vertices, shape [facet_count]
        owner: wp.array(dtype=int)  # its body
        # Bodies:
        solid: wp.array(dtype=int)  # whether its surface has an inside, shape [body_count]
        stiffness: wp.array(dtype=scalar)  # of a contact with an equal body [N/m]
        radius: wp.array(dtype=scalar)  # half of its thickness [m]
        spacing: wp.array(dtype=scalar)  # of its vertices [m]; 0 for a grain
        # Of an ensemble alone:
        bodies_each: int  # bodies of a world
        unit: wp.array(dtype=wp.float64)  # of the forces in each world [N], shape [world_count]

    @wp.struct
    class ContactRules:
        kind: wp.array(dtype=int)  # of each body, shape [body_count]
        table: wp.array2d(dtype=int)  # rule for two kinds of bodies; −1: no contact
        # Of each rule:
        self_contact: wp.array(dtype=int)  # whether a body touches itself
        friction: wp.array(dtype=scalar)
        damping: wp.array(dtype=scalar)  # damping ratio of friction, from the restitution
        hysteresis: wp.array(dtype=scalar)  # also from its restitution
        thickness: wp.array(dtype=scalar)  # [m]; below 0: from the bodies
        stiffness: wp.array(dtype=scalar)  # [N/m]; below 0: from the bodies

    @wp.struct
    class NeighborList:
        x_found: wp.array(dtype=V)  # positions of vertices at the last search [m], in records
        since: wp.array(dtype=float)  # time from the last search to the end of the last substep [s], shape [1]
        due: wp.array(dtype=int)  # whether lists are invalid: NOT_DUE, DUE or FORCED, shape [1]
        # Rows of facets near points, grouped by body:
        candidates: wp.array2d(dtype=wp.vec4i)  # corners of facets, and their numbers, shape [point_count, room]
        candidate_pair: wp.array2d(dtype=int)  # body of each candidate, as an index in the row of body_pairs
        candidate_distance: wp.array2d(dtype=scalar)  # distance at the last search [m]
        candidate_count: wp.array(dtype=int)  # length of each row
        # Points:
        in_order: wp.array(dtype=int)  # points in an order that keeps near points together
        near_own: wp.array(dtype=int)  # whether the point may touch its own body
        search_points: wp.array(dtype=int)  # points to search rows for, in any order
        search_point_count: wp.array(dtype=int)  # number of search_points, shape [1]
        active_points: wp.array(dtype=int)  # points that have a row, or overlap since the start, in any order
        active_count: wp.array(dtype=int)  # number of active_points, shape [1]
        slowest: wp.array(dtype=wp.vec3)  # lowest velocity of active points by axis [m/s], shape [1]
        fastest: wp.array(dtype=wp.vec3)  # highest
        # How far each may move before the next search [m]:
        slack: wp.array(dtype=float)  # of vertices, shape [vertex_count]
        # Least slack of those that have lately moved further than foreseen, else 0, shape [2, vertex_count]:
        overrun: wp.array2d(dtype=float)  # after other searches, and after one at the start of a frame
        started: wp.array(dtype=int)  # whether the last search was at the start of a frame, shape [1]
        facet_slack: wp.array(dtype=scalar)  # of facets: that of their fastest corner, shape [facet_count]
        # Bodies:
        moved: wp.array(dtype=float)  # longest path of its vertices since the last search [m]
        spare: wp.array(dtype=float)  # how much further their vertices may move, if near no other [m]
        body_pairs: wp.array2d(dtype=int)  # bodies that may touch each now, in any order, shape [body_count, room]
        pairs: wp.array2d(dtype=PointAndBody)  # constants of each such pair
        body_pair_count: wp.array(dtype=int)  # length of each row
        root_of_world: wp.array(dtype=int)  # of an ensemble: root of each world's subtree in the tree of bodies

    @wp.struct
    class ContactHistory:
        tangential_displacement: wp.array2d(dtype=V)  # along contact_body [m], shape [HISTORY, point_count]
        contact_body: wp.array2d(dtype=int)  # body that the point touches, −1: none
        fastest: wp.array2d(dtype=scalar)  # fastest approach in this contact [m/s]
        initial_overlap: wp.array(dtype=scalar)  # overlap at the start that is still allowed [m]
        overlap_release_speed: scalar  # rate at which initial_overlap shrinks [m/s]
        done: wp.array(dtype=wp.float64)  # work of depenetration [J]

    @wp.struct
    class BodyContactData:
        surfaces: ContactSurfaces
        rules: ContactRules
        neighbors: NeighborList
        history: ContactHistory

    return BodyContactData


@functools.cache
def NearPairs(scalar: type):
    """Compose the struct of near pairs, and of the impulses and displacement limits that keep them apart."""
    V, W = vector(3, scalar), wp.types.vector(4, scalar)

    @wp.struct
    class NearPairs:
        # Vertices:
        first_particle: wp.array(dtype=int)  # row starts of particle_of and weight
        particle_of: wp.array(dtype=int)
        weight: wp.array(dtype=scalar)  # of each particle
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg]
        body_of: wp.array(dtype=int)
        # Edges; a grain is an edge whose ends are the same:
        edge: wp.array(dtype=wp.vec2i)  # the ends of each, shape [edge_count]
        floor: wp.array(dtype=scalar)  # of each body: half of the gap below which nothing more of it is lost [m]
        rank: wp.array(dtype=int)  # of each body, by the mean length of its edges: 0 for the shortest
        # Facets:
        owned: wp.array(dtype=int)  # its corners (bits 0 to 2) and sides (3 to 5) that belong to no other facet
        points: wp.array(dtype=int)  # six each: in owned corners, in the middle of owned sides; below 0: none
        # The search, see `pair_search`:
        near_facets: wp.array(dtype=wp.vec2i)  # facets whose boxes are near each other
        near_facet_count: wp.array(dtype=int)  # their number, shape [1]
        point_tests: wp.array(dtype=wp.vec3i)  # two facets, and a test of a point of one and the other
        edge_tests: wp.array(dtype=wp.vec3i)  # two facets, and a test of their sides
        test_counts: wp.array(dtype=int)  # numbers of point_tests and edge_tests, shape [2]
        # Pairs:
        vertices: wp.array(dtype=wp.vec4i)  # a vertex and a triangle; or the ends of two edges, the first end as ~
        count: wp.array(dtype=int)  # number of pairs, shape [1]
        weights: wp.array(dtype=W)  # of the vertices in the shortest line from the second side to the first
        normal: wp.array(dtype=V)  # of the plane between the two sides, towards the first
        gap: wp.array(dtype=scalar)  # along the normal, from the second side to the first [m]; <= 0: they cross
        least: wp.array(dtype=scalar)  # the least distance that either side must keep from the plane [m]
        bodies: wp.array(dtype=wp.vec2i)  # of its two sides
        watched: wp.array(dtype=int)  # the pairs that may come too near in this substep, in any order
        watched_count: wp.array(dtype=int)  # number of watched pairs, shape [1]
        pushing: wp.array(dtype=int)  # the pairs that come too near in a round, in any order
        pushed: wp.array(dtype=W)  # weights of the vertices where each is pushed
        change: wp.array(dtype=scalar)  # by how much the approach is to be reduced there [m]
        pushing_count: wp.array(dtype=int)  # number of pushing pairs, shape [1]
        # Particles:
        in_pair: wp.array(dtype=int)  # whether each is in a pair, shape [particle_count]
        particle: wp.array(dtype=int)  # the particles in pairs, in any order
        particle_count: wp.array(dtype=int)  # number of particles in pairs, shape [1]
        inverse_mass: wp.array(dtype=scalar)  # [1/kg], of the particles of all worlds
        pushes: wp.array(dtype=int)  # pairs that push each particle in a round
        impulse: wp.array2d(dtype=wp.int64)  # of pairs on each particle, times the substep [kg m], in units
        truncation: wp.array(dtype=float)  # fraction of its displacement that each particle may make
        held: wp.array(dtype=int)  # whether that fraction was below 1 after an earlier round
        shift: wp.array(dtype=float)  # length of its path by impulses in this substep [m]
        most_weight: float  # largest sum of the absolute weights of a vertex
        anchored: wp.array(dtype=int)  # of each world: whether any particle is pinned; then what is held slows
        driven: wp.array(dtype=int)  # indices of the driven particles
        done: wp.array(dtype=wp.float64)  # work of driven particles on others [J]; empty if none is driven
        contact_impulse: wp.array(dtype=wp.vec3d)  # on each particle [N s]; empty if not requested
        # Rules, see `ContactRules`:
        kind: wp.array(dtype=int)
        rules: wp.array2d(dtype=int)
        restitution: wp.array(dtype=scalar)
        # Results:
        tangles: wp.array(dtype=int)  # whether any edge crosses a triangle, shape [1]
        tangled: wp.array(dtype=int)  # whether `find_tangles` has marked each vertex
        may_meet: wp.array(dtype=int)  # whether any pair may come too near in this substep, shape [1]
        alarm: wp.array(dtype=int)  # whether a pair comes too near in this substep, shape [1]
        many: wp.array(dtype=int)  # whether there are too many pairs for a single launch; 0 after the last round
        round: wp.array(dtype=int)  # round of impulses from 0, if each step of a round is a launch, shape [1]
        exceeded: wp.array(dtype=int)  # whether impulses moved a particle so far that all pairs count, shape [1]
        violated: wp.array(dtype=int)  # last round of impulses in which a pair violated its limit, from 1
        cutting: wp.array(dtype=int)  # whether any displacement is truncated in this substep, shape [1]
        unsettled: wp.array(dtype=int)  # of each world: whether the second-last round held particles back

    return NearPairs


@functools.cache
def Motion(scalar: type):
    """Compose the struct of the motion in a substep, for the kernels that keep near pairs apart."""
    V = vector(3, scalar)

    @wp.struct
    class Motion:
        x: wp.array(dtype=V)  # positions at the substep's start [m]
        x_out: wp.array(dtype=V)  # positions at its end [m]
        v_out: wp.array(dtype=V)  # velocities at its end [m/s]
        h: scalar  # length of the substep [s]
        per_unit: wp.float64  # units of impulse times substep [1/(kg m)]
        activation: scalar  # beyond this distance pairs are left alone [m]
        particles: int  # number of particles in each world

    return Motion


@functools.cache
def Substep(scalar: type):
    """Compose the struct of the current substep, for kernels over contact points."""

    @wp.struct
    class Substep:
        h: scalar  # length of the coming substep [s]; 0 for measurements, which change no history
        rate: scalar  # largest rate of all dampers at a vertex [1/s]
        per_unit: wp.float64  # units of force per newton [1/N]; in an ensemble each world has its own
        buffer: scalar  # the skin [m]
        parts: int  # number of parts for threads of the CPU

    return Substep


@functools.cache
def first_flag(scalar: type, worlds: bool):
    """Compose (data, body) -> the index of the first flag of the body's world; each world has its own flags."""
    Data = BodyContactData(scalar)

    @wp.func
    def first_of(data: Data, body: int) -> int:
        at = int(0)
        if wp.static(worlds):
            at = wp.static(FLAGS) * (body / data.surfaces.bodies_each)
        return at

    return first_of


@functools.cache
def body_contact_term(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the force term of contact between bodies: forces on vertices, divided among their particles."""
    V, entry, weight_of = vector(dim, scalar), table(int), table(scalar)
    Instant = instant(dim, scalar, compensated)

    @wp.struct
    class VertexForces:
        first: wp.array(dtype=int)  # row starts of vertex and weight, shape [particle_count + 1]
        vertex: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # of the particle in each vertex, shape [any]
        force: wp.array2d(dtype=wp.int64)  # on vertices, in units, shape [vertex_count, 3]
        unit: wp.float64  # [N]

    @wp.func
    def push(data: VertexForces, now: Instant, i: int) -> V:
        total = V()
        for s in range(entry(data.first, i), entry(data.first, i + 1)):
            vertex = entry(data.vertex, s)
            for k in range(wp.static(dim)):
                f = wp.float64(data.force[vertex, k]) * data.unit
                total[k] = total[k] + weight_of(data.weight, s) * scalar(f)
        return total

    return ForceTerm("body_contact", VertexForces, force=push, selective=True)
