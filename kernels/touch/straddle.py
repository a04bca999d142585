"""Facets that straddle an obstacle: what comes in between particles, which contact with obstacles does not see.

An obstacle keeps particles out. Between them an edge or a corner of it, or a solid smaller than they are apart, may
come in. So each facet is looked at in so many places, a grid that includes its corners: each that lies in the obstacle
by δ is a spring with the energy k δ²/2 (an integral over the facet, by a sum). Along its signed distance, the
obstacle's own, the spring pushes the corners by the weights of the place. With all of a facet together, at the mean
place by δ,

    f_n = max(0, |Σ k δ n| − b_n u·n)

and friction as between bodies; see `evaluate`. What is in a thin obstacle by much of its thickness may be nearer to
its other side: it is led out of the side that it came in by, whose plane is kept, and counts as that deep up to twice
the distance from the nearest one, so that nothing jumps where it goes in and out. The solids being convex, the plane that touches one nearest to the
middle of a facet has all of it behind: a facet before this plane is not looked at further. That is also so of one
that lies flat on a face, whose particles the obstacle holds.
"""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import compensation
from ..contact import signed_distance, solids
from ..effect import Piece
from ..records import records
from .evaluate import TANGENTIAL
from .surfaces import HISTORY

SIDES = 12
"""Into so many parts the sides of a facet are divided."""
CAP = 2.0
"""How deep, by how far off its nearest side is, anything counts in a thin obstacle that came in by another side."""
PLACES = (SIDES + 1) * (SIDES + 2) // 2
"""Places on a facet that are looked at."""


def weights_of_places() -> list[tuple[float, float, float]]:
    """Return the shares of the corners in each of the places on a facet, shape [PLACES, 3]."""
    rows = [(i, j) for i in range(SIDES + 1) for j in range(SIDES + 1 - i)]
    return [((SIDES - i - j) / SIDES, i / SIDES, j / SIDES) for i, j in rows]


@functools.cache
def Straddled(scalar: type, moving: bool):
    """Compose the struct of facets, and of the obstacles that they may straddle."""
    V, Solids, Turn = vector(3, scalar), solids(3, scalar), wp.types.matrix((3, 3), scalar)

    @wp.struct
    class FacetsAndObstacles:
        place: wp.array(dtype=V)  # shares of the corners in each place, shape [PLACES]
        # Vertices, mixtures of particles:
        first: wp.array(dtype=int)  # where the particles of each begin, shape [vertex_count + 1]
        particle: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # the share of each, shape [any]
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg], shape [vertex_count]
        # Facets, of shape [facet_count] where nothing else is said:
        corner: wp.array(dtype=wp.vec3i)  # the vertices of each
        stiffness: wp.array(dtype=scalar)  # of each place on it [N/m]
        whole: wp.array(dtype=scalar)  # of all around a vertex [N/m]
        slack: wp.array(dtype=scalar)  # how deep is none yet, for roundings [m]
        slip: wp.array2d(dtype=V)  # how far it was moved along what it sticks to [m], shape [HISTORY, any]
        partner: wp.array2d(dtype=int)  # which obstacle that is, −1: none
        way: wp.array2d(dtype=V)  # of what is deep in it the normal of the side it came in by, else 0
        level: wp.array2d(dtype=scalar)  # and how far off that side is along it, both as the obstacle was given [m]
        allowed: wp.array(dtype=scalar)  # how deep it may still lie, since it did at the start [m]
        outwards: scalar  # how fast that shrinks [m/s]
        power: wp.array(dtype=wp.float64)  # what is done on it from outside now [W]
        force: wp.array2d(dtype=wp.int64)  # on particles, in units, shape [particle_count, 3]
        # Obstacles:
        solid: wp.array(dtype=int)  # which of them are no planes, shape [solid_count]
        solids: Solids  # the shapes of all
        friction: wp.array(dtype=scalar)  # of each
        damping: wp.array(dtype=scalar)  # damping ratio, from its restitution
        thin: wp.array(dtype=scalar)  # how deep in it the nearest side may be another one [m]
        if moving:  # where each is at the ends of substeps, see `contact.moving_contact`
            turn: wp.array2d(dtype=Turn)
            shift: wp.array2d(dtype=V)
            turning: wp.array2d(dtype=Turn)
            speed: wp.array2d(dtype=V)

    return FacetsAndObstacles


@functools.cache
def straddling_piece(dim: int, scalar: type, compensated: bool) -> Piece:
    """Return what facets that straddle obstacles add to kernels: the forces on particles."""
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)

    @wp.struct
    class Pushed:
        force: wp.array2d(dtype=wp.int64)  # in units, shape [particle_count, 3]
        unit: wp.float64  # [N]

    def force(World: Any):
        @wp.func
        def push(world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
            total = V()
            for k in range(wp.static(dim)):
                total[k] = scalar(wp.float64(world.straddled.force[i, k]) * world.straddled.unit)
            return total

        return push

    return Piece("straddled", Pushed, force=force, selective=True)


@functools.cache
def straddle(scalar: type, compensated: bool, kinds: tuple[str, ...], moving: bool, sunk: bool, measuring: bool):
    """Compose the kernel of the forces of obstacles on facets, or of what these store [J] and turn to heat [W].

    Its threads share the facets. Where any facet starts on an obstacle (`sunk`), it counts by what it exceeds a
    depth that is allowed, which shrinks to nothing. Forces are summed as whole numbers, as between bodies.
    """
    V, Data = vector(3, scalar), Straddled(scalar, moving)
    Lost, _ = compensation(3, scalar, compensated)
    load, distance_from = records(3, scalar).load, signed_distance(3, scalar, kinds)
    zero, one, third, tangential = scalar(0.0), scalar(1.0), scalar(1.0 / 3.0), scalar(TANGENTIAL)

    @wp.func
    def place_of(data: Data, lost: Lost, x: wp.array(dtype=V), vertex: int) -> V:
        place = V()
        for s in range(data.first[vertex], data.first[vertex + 1]):
            j = data.particle[s]
            x_j = load(x, j)
            if wp.static(compensated):
                x_j = x_j - load(lost.x, j)
            place += data.weight[s] * x_j
        return place

    @wp.func
    def velocity_of(data: Data, v: wp.array(dtype=V), vertex: int) -> V:
        speed = V()
        for s in range(data.first[vertex], data.first[vertex + 1]):
            speed += data.weight[s] * load(v, data.particle[s])
        return speed

    @wp.func
    def seen(data: Data, p: int, row: int, share: scalar, x: V) -> V:
        """Return a place as obstacle p was given, which is on its way by a share of the substep behind a row."""
        if wp.static(moving):
            begun = wp.transpose(data.turn[row, p]) * (x - data.shift[row, p])
            if share > zero:
                ends = wp.transpose(data.turn[row + 1, p]) * (x - data.shift[row + 1, p])
                begun += share * (ends - begun)
            return begun
        return x

    @wp.func
    def turned(data: Data, p: int, row: int, share: scalar, normal: V) -> V:
        """Return a direction that obstacle p was given with, as it is now."""
        if wp.static(moving):
            begun = data.turn[row, p] * normal
            if share > zero:
                begun += share * (data.turn[row + 1, p] * normal - begun)
            return begun
        return normal

    @wp.func
    def add_to(data: Data, vertex: int, f: V, unit: wp.float64):
        for s in range(data.first[vertex], data.first[vertex + 1]):
            part = data.weight[s] * f
            for k in range(3):
                whole = wp.int64(wp.float64(part[k]) / unit)
                wp.atomic_add(data.force, data.particle[s], k, whole)

    @wp.func
    def touch_one(
        data: Data,
        lost: Lost,
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        t: int,
        row: int,  # of the obstacles' poses, where the substep begins
        share: scalar,  # how much of the substep has gone by
        h: scalar,  # length of the substep that begins [s]; 0 where none does, and nothing may slip further
        behind: scalar,  # twice the time by which velocities lag behind positions [s]
        unit: wp.float64,  # of forces [N]
        stored: wp.array(dtype=wp.float64),  # [J], shape [facet_count], where measured
        heated: wp.array(dtype=wp.float64),  # [W]
    ):
        corner = data.corner[t]
        a = place_of(data, lost, x, corner[0])
        b = place_of(data, lost, x, corner[1])
        c = place_of(data, lost, x, corner[2])
        middle = third * (a + b + c)
        k = data.stiffness[t]
        k_t = tangential * scalar(wp.static(float(PLACES))) * k
        begins = data.slack[t]
        if wp.static(sunk):
            begins += data.allowed[t]
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        done = wp.float64(0.0)
        new_partner_0 = int(-1)
        new_partner_1 = int(-1)
        new_slip_0 = V()
        new_slip_1 = V()
        new_side_0 = V()
        new_side_1 = V()
        new_level_0 = zero
        new_level_1 = zero
        for o in range(data.solid.shape[0]):
            p = data.solid[o]
            nearest = distance_from(data.solids, p, seen(data, p, row, share, middle))
            normal = turned(data, p, row, share, V(nearest[0], nearest[1], nearest[2]))
            low = wp.min(wp.dot(normal, a - middle), wp.min(wp.dot(normal, b - middle), wp.dot(normal, c - middle)))
            if nearest[3] + low < -begins:
                # By corners what pushes them; all of it, where, and how much is in.
                f_a = V()
                f_b = V()
                f_c = V()
                w = V()
                deep = zero
                squares = zero
                count = zero
                # What it was in before, and by which side if it is deep.
                slip = V()
                side = V()
                level = zero
                for e in range(wp.static(HISTORY)):
                    if data.partner[e, t] == p:
                        slip = data.slip[e, t]
                        side = data.way[e, t]
                        level = data.level[e, t]
                kept = wp.dot(side, side) > zero
                most_deep = zero
                for s in range(wp.static(PLACES)):
                    part = data.place[s]
                    y = seen(data, p, row, share, part[0] * a + part[1] * b + part[2] * c)
                    found = distance_from(data.solids, p, y)
                    depth = -found[3] - begins
                    if depth > zero:
                        way = V(found[0], found[1], found[2])
                        if kept:
                            behind_side = level - wp.dot(side, y) - begins
                            depth = scalar(wp.static(CAP)) * depth
                            way = scalar(wp.static(CAP)) * way
                            if behind_side < depth:
                                depth = wp.max(behind_side, zero)
                                way = side
                        if depth > most_deep:
                            most_deep = depth
                            if not kept:
                                side = way
                                level = wp.dot(way, y) - found[3]
                        way = turned(data, p, row, share, way)
                        f_a += (part[0] * depth) * way
                        f_b += (part[1] * depth) * way
                        f_c += (part[2] * depth) * way
                        w += depth * part
                        deep += depth
                        squares += depth * depth
                        count += one
                pushed = f_a + f_b + f_c
                size = wp.length(pushed)
                mobility = zero
                if deep > zero:
                    w = w / deep
                    for j in range(3):
                        mobility += w[j] * w[j] * data.mobility[corner[j]]
                if size > zero and mobility > zero:
                    normal = pushed / size
                    u = w[0] * velocity_of(data, v, corner[0])
                    u += w[1] * velocity_of(data, v, corner[1])
                    u += w[2] * velocity_of(data, v, corner[2])
                    surface = V()
                    if wp.static(moving):
                        y = seen(data, p, row, share, w[0] * a + w[1] * b + w[2] * c)
                        surface = scalar(0.5) * (
                            data.turning[row, p] * y
                            + data.speed[row, p]
                            + data.turning[row + 1, p] * y
                            + data.speed[row + 1, p]
                        )
                        u = u - surface
                    u_n = wp.dot(u, normal)
                    u_t = u - u_n * normal
                    # What is in has its share of the stiffness around a vertex, and so of the mass.
                    b_n = scalar(2.0) * data.damping[p] * count * k / wp.sqrt(data.whole[t] * mobility)
                    b_t = wp.sqrt(tangential) * b_n
                    late = one / (one + behind * b_n * mobility)
                    b_t = b_t / (one + behind * b_t * mobility)
                    f_n = wp.max(zero, k * size - late * b_n * u_n)
                    slip = slip - wp.dot(slip, normal) * normal + h * u_t
                    most = data.friction[p] * f_n
                    stretched = k_t * wp.length(slip)
                    if stretched > most:
                        slip = slip * (most / stretched)
                    f_t = -k_t * slip - b_t * u_t
                    pull = wp.length(f_t)
                    slides = pull > most
                    if slides:
                        f_t = f_t * (most / pull)
                    if wp.static(measuring):
                        energy += wp.float64(scalar(0.5) * (k * squares + k_t * wp.dot(slip, slip)))
                        heat = (k * size - f_n) * u_n - wp.dot(f_t, u_t)
                        if not slides:
                            heat -= k_t * wp.dot(slip, u_t)
                        power += wp.float64(heat)
                    else:
                        by = f_n / size
                        add_to(data, corner[0], by * f_a + w[0] * f_t, unit)
                        add_to(data, corner[1], by * f_b + w[1] * f_t, unit)
                        add_to(data, corner[2], by * f_c + w[2] * f_t, unit)
                        if wp.static(moving):
                            done += wp.float64(wp.dot(f_n * normal + f_t, surface))
                        if wp.static(sunk):
                            if data.allowed[t] > zero:
                                done += wp.float64(k * deep * data.outwards)
                    if most_deep < data.thin[p]:
                        side = V()
                    if new_partner_0 < 0:
                        new_partner_0 = p
                        new_slip_0 = slip
                        new_side_0 = side
                        new_level_0 = level
                    elif new_partner_1 < 0:
                        new_partner_1 = p
                        new_slip_1 = slip
                        new_side_1 = side
                        new_level_1 = level
        if wp.static(measuring):
            stored[t] = energy
            heated[t] = power
        else:
            if h > zero:
                data.partner[0, t] = new_partner_0
                data.partner[1, t] = new_partner_1
                data.slip[0, t] = new_slip_0
                data.slip[1, t] = new_slip_1
                data.way[0, t] = new_side_0
                data.way[1, t] = new_side_1
                data.level[0, t] = new_level_0
                data.level[1, t] = new_level_1
            if wp.static(sunk):
                data.allowed[t] = wp.max(zero, data.allowed[t] - h * data.outwards)
            if wp.static(moving or sunk):
                data.power[t] = done

    @kernel
    def straddle_facets(
        data: Data,
        lost: Lost,
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        row: int,
        share: scalar,
        h: scalar,
        behind: scalar,
        unit: wp.float64,
        threads: int,
        stored: wp.array(dtype=wp.float64),
        heated: wp.array(dtype=wp.float64),
    ):
        t = wp.tid()
        while t < data.corner.shape[0]:
            touch_one(data, lost, x, v, t, row, share, h, behind, unit, stored, heated)
            t += threads

    return straddle_facets


@functools.cache
def add_pushes(scalar: type):
    """Compose the kernel, over particles, that adds what obstacles push facets with to what they push particles with.

    That is summed by mass, in float64.
    """
    Wide = vector(3, wp.float64)

    @kernel
    def add_push(
        force: wp.array2d(dtype=wp.int64),  # in units, shape [particle_count, 3]
        unit: wp.float64,  # [N]
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], shape [particle_count]
        seconds: wp.float64,  # how long the forces count [s]
        # In and out:
        impulse: wp.array(dtype=Wide),  # by mass [m/s], shape [particle_count]
    ):
        i = wp.tid()
        by_mass = seconds * unit * wp.float64(inverse_mass[i])
        total = Wide()
        for k in range(3):
            total[k] = by_mass * wp.float64(force[i, k])
        impulse[i] = impulse[i] + total

    return add_push


@kernel
def add_energies(
    power: wp.array(dtype=wp.float64),  # [W], shape [any]
    seconds: wp.float64,  # [s]
    # In and out:
    done: wp.array(dtype=wp.float64),  # [J], shape [any]
):
    """Add what powers do in some time."""
    i = wp.tid()
    done[i] = done[i] + seconds * power[i]
