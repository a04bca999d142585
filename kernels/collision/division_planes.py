"""Division planes: surfaces that do not cross when a substep begins do not cross when it ends.

So cloth does not pass through itself or other bodies. Near pairs of a vertex and a triangle, or of two edges, are
listed. When a substep begins, a plane separates the vertex from the triangle, or one edge from the other. When it
ends, `pair_gaps` finds whether any pair has lost more of its gap than it may: it keeps 0.8 of it, or a tenth of
the thickness if that is more, unless it stays wide. If so,

1. impulses act between the two sides of each such pair, in a few rounds. All pairs act at the same time, so each
   divides the mass of a particle by the number of pairs that push it;
2. if a pair would still come too near, the displacements of those particles that would reach its plane in this
   substep are shortened. Then the other pairs of these particles are tested against their planes, and so on.
   Velocities stay, so that momentum and angular momentum are kept; impulses reduce them in the next substeps.
   Where any particle is pinned or driven, which takes momentum anyway, they are cut as the displacements are. Else
   forces would accelerate, without work, what is held back, as in a knot that is pulled tight.

The two sides of a pair then stay on their sides of a plane during the whole substep, since particles move on
straight lines. The plane is at rest if a particle of the pair is held back; else it moves with the pair, so that
bodies that fly together are not held back. The impulses of a pair sum to 0 and are added as integers, and a
displacement is shortened to the least that any of its pairs allows. So the order of pairs changes no result.
References: Chen et al., Offset geometric contact, ACM TOG 44 (2025); Tonge et al., Mass splitting for jitter-free
parallel rigid body simulation, ACM TOG 31 (2012).
"""

import functools

import warp as wp

from ..basis import kernel, vector
from ..partition import count_up, raise_to
from ..records import records
from ..threads import grid_thread, wait
from .contact_data import FLAGS, HELD_BACK, NearPairs
from .near_pairs import vertex_of
from .pair_gaps import longest_shifts, ways
from .pair_impulses import pair_impulses

ROUNDS = 4
"""Maximal number of rounds of impulses."""
ALLOWED = 0.8
"""Fraction of its distance from the plane by which a vertex may approach the plane."""
LEAST_SHARE = 0.05
"""The least fraction of the gap on either side of a plane."""
CATCH_UP = 50.0
"""How far a particle with a drive at rest may go in a substep to catch up, as a multiple of the least gap."""
FORESEEN = 4.0
"""Ratio of the expected path by impulses to that of the last substep; pairs that it cannot close are skipped."""
CUTS = 4
"""Rounds in which displacements are shortened. The last is for all pairs, in case more would be needed."""
PHASES = 3 * ROUNDS + 2 * CUTS
"""Phases of `keep_apart`: three for each round of impulses, two for each in which displacements are shortened; the
last holds particles back. One phase ends before the next begins."""
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

    @kernel
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
            way = h * load(v_out, i)
            behind = load(x_out, i) - load(x, i) - way
            most = wp.max(wp.length(way), scalar(CATCH_UP) * least)
            if wp.length(behind) > most:
                store(x_out, i, load(x, i) + way + (most / wp.length(behind)) * behind)
            n += threads

    return follow


@functools.cache
def keep_apart(scalar: type, blocks: int):
    """Compose the kernel that keeps near pairs apart, in phases; its threads divide the pairs and particles.

    A launch of several phases has one cluster of `blocks` blocks, or on the CPU one thread.
    """
    V, W = vector(3, scalar), wp.types.vector(4, scalar)
    Pairs, (load, store, _) = NearPairs(scalar), records(3, scalar)
    place_of, way_towards, approach_of = ways(scalar)
    _, _, may_approach, lacks, count_pushes, push, apply = pair_impulses(scalar)
    zero, one, longest_shift = scalar(0.0), scalar(1.0), longest_shifts(scalar)

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
    def shorten(
        pairs: Pairs,
        x: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        apart: scalar,
        everywhere: bool,
        calm: bool,
        k: int,
    ):
        """Reduce the fractions of displacement that particles of pair k may make, so that none reaches its plane.

        Unless `everywhere`, only if one was held back, or if the pair comes too near and is not `calm`.
        """
        normal = pairs.normal[k]
        gap = pairs.gap[k]
        if gap <= zero:
            return
        largest = may_approach(gap, pairs.least[k], apart)
        if not everywhere and (calm or approach_of(pairs, x, x_out, k) <= largest) and not is_held(pairs, k):
            return
        vertices = pairs.vertices[k]
        firsts = int(1)
        if vertices[0] < 0:
            firsts = 2
        ways = W()
        furthest_first = zero
        furthest_second = zero
        mobility_first = zero
        mobility_second = zero
        for m in range(4):
            v = vertex_of(vertices, m)
            mobility = pairs.mobility[v]
            if m < firsts:
                ways[m] = way_towards(pairs, x, x_out, v, normal)
                furthest_first = wp.max(furthest_first, ways[m])
                mobility_first += mobility
            else:
                ways[m] = way_towards(pairs, x, x_out, v, -normal)
                furthest_second = wp.max(furthest_second, ways[m])
                mobility_second += mobility
        most = wp.max(scalar(ALLOWED) * (gap - scalar(2.0) * pairs.least[k]), gap - apart)
        if furthest_first + furthest_second <= most:
            return
        # The plane's place, as a fraction of the gap from the second side: the faster side has more room, and a
        # driven side as much as it needs.
        share = furthest_second / (furthest_first + furthest_second)
        if mobility_first == zero and mobility_second > zero:
            share = one - (furthest_first / scalar(ALLOWED) + pairs.least[k]) / gap
        if mobility_second == zero and mobility_first > zero:
            share = (furthest_second / scalar(ALLOWED) + pairs.least[k]) / gap
        share = wp.clamp(share, scalar(LEAST_SHARE), one - scalar(LEAST_SHARE))
        f, p, w = pairs.first_particle, pairs.particle_of, pairs.weight
        origin = place_of(f, p, w, x, vertices[3])
        highest = zero  # vertex of the second side, along the normal from vertices[3] [m]
        for m in range(firsts, 3):
            highest = wp.max(highest, wp.dot(place_of(f, p, w, x, vertices[m]) - origin, normal))
        for m in range(4):
            if ways[m] > zero:
                v = vertex_of(vertices, m)
                height = wp.dot(place_of(f, p, w, x, v) - origin, normal) - highest - share * gap
                if m >= firsts:
                    height = -height
                allowed = scalar(ALLOWED) * wp.max(zero, height - pairs.least[k])
                if ways[m] > allowed:
                    pairs.cutting[0] = 1
                    for s in range(f[v], f[v + 1]):
                        lower_to(pairs.share, p[s], wp.float32(0.9999 * wp.float32(allowed / ways[m])))

    @wp.func
    def hold_back(
        pairs: Pairs,
        x: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        h: scalar,
        unit: wp.float64,
        particles: int,
        i: int,
    ) -> float:
        """Shorten the displacement of particle i to the fraction that its pairs allow; return the loss [m].

        Its velocity stays, which keeps momentum and angular momentum; it changes as the displacement does if any
        particle is pinned or driven.
        """
        share = scalar(pairs.share[i])
        if share == one:
            return float(0.0)
        lost = (share - one) * (load(x_out, i) - load(x, i))
        pairs.share[i] = 1.0
        pairs.held[i] = 0
        store(x_out, i, load(x_out, i) + lost)
        if pairs.anchored[i / particles] != 0:
            store(v_out, i, load(v_out, i) + lost / h)
            if pairs.contact_impulse.shape[0] > 0 and pairs.inverse_mass[i] > zero:
                pairs.contact_impulse[i] += wp.vec3d(lost) / wp.float64(h * pairs.inverse_mass[i])
        return float(wp.length(lost))

    @wp.func
    def act(
        pairs: Pairs,
        x: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        per_unit: wp.float64,
        apart: scalar,
        particles: int,
        phase: int,
        k: int,
    ):
        """Run one phase for pair k: count it at its particles, add its impulses, or limit displacements."""
        # Even with the impulses on these bodies the pair has not come too near.
        calm = pairs.reserve[k] - pairs.least[k] > scalar(1.001 * longest_shift(pairs, pairs.most_shift, k))
        if calm and phase <= wp.static(3 * ROUNDS):
            return
        if phase >= wp.static(3 * ROUNDS):
            everywhere = bool(False)
            if phase == wp.static(PHASES - 2):
                particle = pairs.particle_of[pairs.first_particle[vertex_of(pairs.vertices[k], 0)]]
                everywhere = pairs.unsettled[particle / particles] != 0
            shorten(pairs, x, x_out, apart, everywhere, calm, k)
        elif pairs.gap[k] > zero:
            weights, change = lacks(pairs, x, x_out, apart, k)
            if change > zero:
                if phase % 3 == 0:
                    pairs.lacking[0] = phase / 3 + 1
                    pairs.pushing[count_up(pairs.pushing_count, 0)] = k
                    count_pushes(pairs, k, weights)
                else:
                    push(pairs, k, weights, change, per_unit)

    @wp.func
    def end_phase(
        pairs: Pairs,
        x: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        h: scalar,
        per_unit: wp.float64,
        particles: int,
        phase: int,
        flags: wp.array(dtype=float),
        n: int,
    ):
        """Run one phase for a particle: apply its impulses, store that it is held back, or hold it back."""
        i = pairs.particle[n]
        if phase < wp.static(3 * ROUNDS):
            pairs.pushing_count[0] = 0
            apply(pairs, x, x_out, v_out, h, wp.float64(1.0) / per_unit, i)
        elif phase < wp.static(PHASES - 1):
            if pairs.share[i] < 1.0 and pairs.held[i] == 0:
                pairs.held[i] = 1
                if phase == wp.static(PHASES - 3):
                    pairs.unsettled[i / particles] = 1
        else:
            pairs.unsettled[i / particles] = 0
            pairs.shift[i] = 0.0
            lost = hold_back(pairs, x, x_out, v_out, h, wp.float64(1.0) / per_unit, particles, i)
            if lost > 0.0:
                raise_to(flags, (i / particles) * wp.static(FLAGS) + wp.static(HELD_BACK), lost)

    @wp.func
    def end(pairs: Pairs, thread: int, threads: int):
        """Estimate the paths due to impulses in the next substep from those in this one."""
        body = thread
        while body < pairs.most_shift.shape[0]:
            longest = wp.static(FORESEEN) * pairs.most_shift[body]
            pairs.foreseen[body] = wp.max(longest, 0.5 * pairs.foreseen[body])
            pairs.most_shift[body] = 0.0
            body += threads
        pairs.exceeded[0] = 0

    def keep(
        pairs: Pairs,
        x: wp.array(dtype=V),  # positions at the substep's start [m]
        h: scalar,  # length of the substep [s]
        per_unit: wp.float64,  # units of impulse times substep [1/(kg m)]
        apart: scalar,  # beyond this distance pairs are left alone [m]
        particles: int,  # number of particles in each world
        most: int,  # a single launch of all phases does nothing with more pairs: then each phase is a launch
        first_phase: int,  # 0 to 2 if the launch is a phase of round `pairs.round`
        last_phase: int,
        threads: int,
        # In and out: positions and velocities at its end
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        flags: wp.array(dtype=float),
    ):
        single = first_phase < last_phase
        count = wp.min(pairs.count[0], pairs.vertices.shape[0])
        watched = pairs.watched_count[0]
        if single and grid_thread() == 0:
            pairs.may_meet[0] = 0
        if pairs.alarm[0] == 0:
            if single and grid_thread() == 0:
                pairs.watched_count[0] = 0
            return
        if single and (count > most or watched > most / 4):
            pairs.many[0] = 1
            return
        phase = first_phase
        last = last_phase
        if not single and phase < 3:
            phase += 3 * pairs.round[0]
            last = phase
        while phase <= last:
            cut = phase - wp.static(3 * ROUNDS)
            # A round is run only if pairs came too near in the one before. Displacements are shortened further
            # only if any has been shortened.
            needed = phase == 0 or pairs.lacking[0] >= (phase + 2) / 3
            if cut >= 0:
                needed = cut == 0 or phase == wp.static(PHASES - 1) or pairs.cutting[0] != 0
            if needed:
                n = grid_thread()
                of_particles = cut > 0 and cut % 2 == 1 and phase < wp.static(PHASES - 1)
                if (cut < 0 and phase % 3 == 2) or of_particles or phase == wp.static(PHASES - 1):
                    while n < pairs.particle_count[0]:
                        end_phase(pairs, x, x_out, v_out, h, per_unit, particles, phase, flags, n)
                        n += threads
                    if phase == wp.static(PHASES - 1):
                        end(pairs, grid_thread(), threads)
                else:
                    pushes = cut < 0 and phase % 3 == 1
                    watches = not pushes and cut <= 0 and pairs.exceeded[0] == 0
                    end_of_list = count
                    if pushes:
                        end_of_list = pairs.pushing_count[0]
                    elif watches:
                        end_of_list = watched
                    while n < end_of_list:
                        k = n
                        if pushes:
                            k = pairs.pushing[n]
                        elif watches:
                            k = pairs.watched[n]
                        # The only call: compilers copy this long function to each, which takes 10 s for a GPU.
                        act(pairs, x, x_out, per_unit, apart, particles, phase, k)
                        n += threads
                if phase < last:
                    wait()
            elif phase < wp.static(3 * ROUNDS) and last > phase:
                phase = wp.static(3 * ROUNDS - 1)
            phase += 1
        if single and grid_thread() == 0:
            pairs.alarm[0] = 0
            pairs.watched_count[0] = 0

    return kernel(keep, launch_bounds=MOST_THREADS, cluster_dim=blocks)


@functools.cache
def end_round(scalar: type):
    """Compose the kernel that ends a round whose phases are launches; it clears `many` after the last."""
    Pairs = NearPairs(scalar)

    @kernel
    def end_round_of_impulses(pairs: Pairs):
        following = pairs.round[0] + 1
        pairs.round[0] = following
        if pairs.lacking[0] < following or following == wp.static(ROUNDS):
            pairs.many[0] = 0

    return end_round_of_impulses
