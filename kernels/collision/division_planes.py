"""Division planes: surfaces that do not cross when a substep begins do not cross when it ends.

So cloth does not pass through itself or other bodies. Near pairs of a vertex and a triangle, or of two edges, are
listed. When a substep begins, a plane separates the vertex from the triangle, or one edge from the other. When it
ends, `pair_gaps` finds whether any pair comes too near. A pair may lose a fifth of its gap, but not come nearer
than a tenth of the thickness of contact; gaps that stay wide may shrink at will. If a pair comes too near,

1. impulses act between the two sides of each such pair, in a few rounds. All pairs act at the same time, so each
   divides the mass of a particle by the number of pairs that push it;
2. if a pair would still come too near, the displacements of those particles that would reach its plane in this
   substep are truncated. Then the other pairs of these particles are tested against their planes, and so on.
   Velocities stay, so that momentum and angular momentum are kept; impulses reduce them in the next substeps.
   In worlds with pinned or driven particles, which do not keep momentum anyway, velocities are reduced with the
   displacements. Otherwise forces would accelerate particles that are held back and do not move, as in a knot that
   is pulled tight.

The two sides of a pair then stay on their sides of a plane during the whole substep, since particles move on
straight lines. The plane is at rest if a particle of the pair is held back. Otherwise it moves with the pair, so
that bodies that fly together are not held back. The impulses of a pair sum to 0 and are added as integers, and a
displacement is truncated to the least that any of its pairs allows. So the order of pairs changes no result.
References: Chen et al., Offset geometric contact, ACM TOG 44 (2025); Tonge et al., Mass splitting for jitter-free
parallel rigid body simulation, ACM TOG 31 (2012).
"""

import functools

import warp as wp

from ..basis import as_function, fast_kernel, vector
from ..partition import raise_to
from ..records import records
from ..threads import grid_thread, wait
from .contact_data import FLAGS, HELD_BACK, Motion, NearPairs
from .near_pairs import vertex_of
from .pair_gaps import displacements
from .pair_impulses import find_violations, limits, move_pushed, push_pairs

ROUNDS = 24
"""Maximal number of rounds of impulses; with 4 a rope that winds around a free cloth gained half of its energy."""
ALLOWED = 0.8
"""Fraction of its distance from the plane by which a vertex may approach the plane."""
LEAST_FRACTION = 0.05
"""The least fraction of the gap on either side of a plane."""
CATCH_UP = 50.0
"""How far a particle with a drive at rest may go in a substep to catch up, as a multiple of the least gap."""
CUTS = 4
"""Rounds in which displacements are truncated. The last is for all pairs, in case more would be needed."""
MOST_THREADS = 256
"""Threads in a block; the compiler leaves registers for this many."""

LOWER = """
#if defined(__CUDA_ARCH__)
    atomicMin(reinterpret_cast<int*>(&wp::index(numbers, i)), __float_as_int(value));
#else
    float& number = wp::index(numbers, i);
    number = value < number ? value : number;
#endif
"""


@wp.func_native(LOWER)
def lower_to(numbers: wp.array(dtype=float), i: int, value: float):
    """Replace numbers[i] by `value` if that is less; both are >= 0, so that their bits have the same order."""
    ...


@functools.cache
def catch_up(scalar: type):
    """Compose the kernel that limits how fast driven particles that were held back return to their drive.

    In a substep they move at most twice as far as the drive, or `CATCH_UP` times the smallest gap if that is more.
    """
    V, Pairs = vector(3, scalar), NearPairs(scalar)
    load, store, _ = records(3, scalar)

    @fast_kernel
    def follow(
        pairs: Pairs,
        x: wp.array(dtype=V),  # positions at the substep's start [m]
        h: scalar,  # length of the substep [s]
        least: scalar,  # the least distance from a plane [m]
        threads: int,
        # In and out: positions and velocities at its end
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
    ):
        n = grid_thread()
        while n < pairs.driven.shape[0]:
            i = pairs.driven[n]
            displacement = h * load(v_out, i)
            behind = load(x_out, i) - load(x, i) - displacement
            most = wp.max(wp.length(displacement), scalar(CATCH_UP) * least)
            if wp.length(behind) > most:
                store(x_out, i, load(x, i) + displacement + (most / wp.length(behind)) * behind)
            n += threads

    return follow


@functools.cache
def truncate_displacements(scalar: type):
    """Compose the kernel that reduces the fractions of displacements which particles may make.

    Its threads divide the pairs. `number` is that of the round, from 0. The first round handles pairs that come
    too near, the next ones also pairs with a particle that is held back. The last round handles all pairs of a
    world in which the round before held any particle back.
    """
    W, Pairs, Moving = wp.types.vector(4, scalar), NearPairs(scalar), Motion(scalar)
    (place_of, displacement_towards, approach_of), may_approach = displacements(scalar), limits(scalar)[1]
    zero, one = scalar(0.0), scalar(1.0)

    @wp.func
    def is_held(pairs: Pairs, k: int) -> bool:
        """Tell whether a particle of pair k has been held back in an earlier round."""
        found = bool(False)
        for m in range(4):
            v = vertex_of(pairs.vertices[k], m)
            for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                found = found or pairs.held[pairs.particle_of[s]] != 0
        return found

    @wp.func
    def truncate(pairs: Pairs, motion: Moving, everywhere: bool, k: int):
        """Reduce the fractions of displacement that particles of pair k may make, so that none reaches its plane.

        Unless `everywhere`, this is done only if the pair comes too near or one of its particles was held back.
        """
        x, x_out, activation = motion.x, motion.x_out, motion.activation
        normal = pairs.normal[k]
        gap = pairs.gap[k]
        if gap <= zero:
            return
        largest = may_approach(gap, pairs.least[k], activation)
        if not everywhere and approach_of(pairs, x, x_out, k) <= largest and not is_held(pairs, k):
            return
        vertices = pairs.vertices[k]
        firsts = int(1)
        if vertices[0] < 0:
            firsts = 2
        towards = W()
        furthest_first = zero
        furthest_second = zero
        mobility_first = zero
        mobility_second = zero
        for m in range(4):
            v = vertex_of(vertices, m)
            mobility = pairs.mobility[v]
            if m < firsts:
                towards[m] = displacement_towards(pairs, x, x_out, v, normal)
                furthest_first = wp.max(furthest_first, towards[m])
                mobility_first += mobility
            else:
                towards[m] = displacement_towards(pairs, x, x_out, v, -normal)
                furthest_second = wp.max(furthest_second, towards[m])
                mobility_second += mobility
        most = wp.max(scalar(ALLOWED) * (gap - scalar(2.0) * pairs.least[k]), gap - activation)
        if furthest_first + furthest_second <= most:
            return
        # The plane's place, as a fraction of the gap from the second side: the faster side has more room, and a
        # driven side as much as it needs.
        place = furthest_second / (furthest_first + furthest_second)
        if mobility_first == zero and mobility_second > zero:
            place = one - (furthest_first / scalar(ALLOWED) + pairs.least[k]) / gap
        if mobility_second == zero and mobility_first > zero:
            place = (furthest_second / scalar(ALLOWED) + pairs.least[k]) / gap
        place = wp.clamp(place, scalar(LEAST_FRACTION), one - scalar(LEAST_FRACTION))
        f, p, w = pairs.first_particle, pairs.particle_of, pairs.weight
        origin = place_of(f, p, w, x, vertices[3])
        highest = zero  # vertex of the second side, along the normal from vertices[3] [m]
        for m in range(firsts, 3):
            highest = wp.max(highest, wp.dot(place_of(f, p, w, x, vertices[m]) - origin, normal))
        for m in range(4):
            if towards[m] > zero:
                v = vertex_of(vertices, m)
                height = wp.dot(place_of(f, p, w, x, v) - origin, normal) - highest - place * gap
                if m >= firsts:
                    height = -height
                allowed = scalar(ALLOWED) * wp.max(zero, height - pairs.least[k])
                if towards[m] > allowed:
                    pairs.cutting[0] = 1
                    for s in range(f[v], f[v + 1]):
                        lower_to(pairs.truncation, p[s], wp.float32(0.9999 * wp.float32(allowed / towards[m])))

    @fast_kernel
    def truncate_all(pairs: Pairs, motion: Moving, number: int, threads: int):
        every = number > 0 or pairs.exceeded[0] != 0
        last = pairs.watched_count[0]
        if every:
            last = wp.min(pairs.count[0], pairs.vertices.shape[0])
        if number > 0 and pairs.cutting[0] == 0:
            last = int(0)
        n = grid_thread()
        while n < last:
            k = n
            if not every:
                k = pairs.watched[n]
            everywhere = bool(False)
            if number == wp.static(CUTS - 1):
                particle = pairs.particle_of[pairs.first_particle[vertex_of(pairs.vertices[k], 0)]]
                everywhere = pairs.unsettled[particle / motion.particles] != 0
            truncate(pairs, motion, everywhere, k)
            n += threads

    return truncate_all


@functools.cache
def mark_held(scalar: type):
    """Compose the kernel that marks the particles which are held back; its threads divide the particles."""
    Pairs, Moving = NearPairs(scalar), Motion(scalar)

    @fast_kernel
    def mark_all(pairs: Pairs, motion: Moving, number: int, threads: int):
        n = grid_thread()
        while n < pairs.particle_count[0] and pairs.cutting[0] != 0:
            i = pairs.particle[n]
            if pairs.truncation[i] < 1.0 and pairs.held[i] == 0:
                pairs.held[i] = 1
                if number == wp.static(CUTS - 2):
                    pairs.unsettled[i / motion.particles] = 1
            n += threads

    return mark_all


@functools.cache
def hold_particles(scalar: type):
    """Compose the kernel that truncates displacements, and ends the substep; its threads divide the particles."""
    Pairs, Moving = NearPairs(scalar), Motion(scalar)
    (load, store, _), zero, one = records(3, scalar), scalar(0.0), scalar(1.0)

    @wp.func
    def hold_back(pairs: Pairs, motion: Moving, i: int) -> float:
        """Shorten the displacement of particle i to the fraction that its pairs allow; return the loss [m].

        Its velocity stays, which keeps momentum and angular momentum. If any particle of its world is pinned or
        driven, its velocity is reduced by loss / h instead.
        """
        x_out, v_out, h = motion.x_out, motion.v_out, motion.h
        factor = scalar(pairs.truncation[i])
        if factor == one:
            return float(0.0)
        lost = (factor - one) * (load(x_out, i) - load(motion.x, i))
        pairs.truncation[i] = 1.0
        pairs.held[i] = 0
        store(x_out, i, load(x_out, i) + lost)
        if pairs.anchored[i / motion.particles] != 0:
            store(v_out, i, load(v_out, i) + lost / h)
            if pairs.contact_impulse.shape[0] > 0 and pairs.inverse_mass[i] > zero:
                pairs.contact_impulse[i] += wp.vec3d(lost) / wp.float64(h * pairs.inverse_mass[i])
        return float(wp.length(lost))

    @fast_kernel
    def hold_all(pairs: Pairs, motion: Moving, threads: int, flags: wp.array(dtype=float)):
        n = grid_thread()
        if n == 0:
            pairs.exceeded[0] = 0
        while n < pairs.particle_count[0]:
            i = pairs.particle[n]
            pairs.unsettled[i / motion.particles] = 0
            pairs.shift[i] = 0.0
            lost = hold_back(pairs, motion, i)
            if lost > 0.0:
                raise_to(flags, (i / motion.particles) * wp.static(FLAGS) + wp.static(HELD_BACK), lost)
            n += threads

    return hold_all


@functools.cache
def keep_apart(scalar: type, blocks: int):
    """Compose the kernel that keeps near pairs apart in one launch.

    It runs in a cluster of `blocks` blocks, or in one CPU thread. If there are too many pairs for these, it only
    sets `many`, and the host launches the kernels above one by one. The numbers of rounds are arguments, since a
    compiler would unroll loops of constant length, whose bodies are long.
    """
    Pairs, Moving = NearPairs(scalar), Motion(scalar)
    find, push, move = (as_function(one(scalar)) for one in (find_violations, push_pairs, move_pushed))
    truncate, mark, hold = (
        as_function(one(scalar)) for one in (truncate_displacements, mark_held, hold_particles)
    )

    def keep(
        pairs: Pairs,
        motion: Moving,
        most: int,  # number of pairs above which each kernel is a launch
        rounds: int,
        cuts: int,
        threads: int,
        flags: wp.array(dtype=float),
    ):
        first = grid_thread() == 0
        count = wp.min(pairs.count[0], pairs.vertices.shape[0])
        watched = pairs.watched_count[0]
        if first:
            pairs.may_meet[0] = 0
        if pairs.alarm[0] == 0:
            if first:
                pairs.watched_count[0] = 0
            return
        if count > most or watched > most / 4:
            pairs.many[0] = 1
            return
        for number in range(rounds):
            find(pairs, motion, number, threads)
            wait()
            if pairs.violated[0] <= number:
                break
            push(pairs, motion, number, threads)
            wait()
            move(pairs, motion, number, threads)
            wait()
        for number in range(cuts):
            truncate(pairs, motion, number, threads)
            wait()
            if pairs.cutting[0] == 0:
                break
            if number < cuts - 1:
                mark(pairs, motion, number, threads)
                wait()
        hold(pairs, motion, threads, flags)
        if first:
            pairs.alarm[0] = 0
            pairs.watched_count[0] = 0

    return fast_kernel(keep, launch_bounds=MOST_THREADS, cluster_dim=blocks)


@functools.cache
def end_round(scalar: type):
    """Compose the kernel that ends a round of impulses launched one by one; after the last it clears `many`."""
    Pairs = NearPairs(scalar)

    @fast_kernel
    def end_round_of_impulses(pairs: Pairs):
        following = pairs.round[0] + 1
        pairs.round[0] = following
        if pairs.violated[0] < following or following == wp.static(ROUNDS):
            pairs.many[0] = 0

    return end_round_of_impulses
