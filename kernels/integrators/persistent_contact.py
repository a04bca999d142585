"""Many substeps in one launch for small bodies in contact: all contact kernels become parts of one kernel.

`engine/stepping/contact_launch.py` decides when to use it.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import as_function, kernel
from ..collision import (
    BodyContactData,
    FacetTree,
    NearPairs,
    begin_search,
    box_facets,
    box_neighbours,
    clear_pairs,
    count_contacts,
    evaluate_contact,
    find_alarm,
    find_candidates,
    find_pairs,
    find_rows,
    place_inner,
    place_vertices,
    range_of_speeds,
)
from ..places import arrays_of, on_device
from ..threads import grid_thread, wait
from .composition import Composition, beginning, by_first_lane, tools
from .persistent import MOST_THREADS

SEARCH_LANES = 8
"""Threads per point in a search; a cluster has too few threads for more."""


class ContactParts(NamedTuple):
    """Options by which a kernel with contact is composed."""

    overlapping_at_start: bool
    limited: bool
    """Whether dampers of contacts are limited."""
    inner: bool
    """Whether closed bodies have inner surfaces."""
    lanes: int
    """Threads per point in the evaluation of forces."""


@functools.cache
def ContactNumbers(scalar: type):
    """Compose the struct of all arguments of the contact kernels, under the names of their parameters."""

    @wp.struct
    class ContactNumbers:
        h: scalar  # length of a substep [s]
        behind: scalar
        per_unit: wp.float64
        ahead: float
        more: float
        beyond: float
        farthest: scalar
        apart: scalar

    return ContactNumbers


@functools.cache
def search_in_launch(scalar: type, inner: bool):
    """Compose (data, tree, pairs, numbers, buffer, flags, threads): build the lists for the current vertices."""
    Data, Pairs, Numbers = BodyContactData(scalar, False), NearPairs(scalar), ContactNumbers(scalar)
    lanes = SEARCH_LANES
    begin, clear = as_function(begin_search(scalar)), as_function(clear_pairs(scalar))
    box, neighbours = as_function(box_facets(scalar, lanes)), as_function(box_neighbours(scalar, lanes))
    candidates, rows = as_function(find_candidates(scalar)), as_function(find_rows(scalar, lanes))
    inside, near = as_function(place_inner(scalar)), as_function(find_pairs(scalar, False, lanes, inner))
    speeds = as_function(range_of_speeds(scalar, lanes))

    @wp.func
    def search(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        numbers: Numbers,
        buffer: wp.array(dtype=scalar),
        flags: wp.array(dtype=float),
        threads: int,
    ):
        begin(data, tree, 0.0, threads)
        if wp.static(inner):
            clear(pairs, threads)
        wait()
        box(data, tree, threads)
        if wp.static(inner):
            inside(data, pairs, threads)
        wait()
        neighbours(data, tree, wp.uint64(0), numbers.farthest, buffer, threads, flags)
        wait()
        candidates(data, tree, numbers.farthest, buffer, threads, 0, 1)
        wait()
        rows(data, tree, numbers.farthest, buffer, threads, 0, 1, flags)
        if wp.static(inner):
            near(data, tree, pairs, buffer, numbers.apart, threads, 0, 1, flags)
        wait()
        speeds(data, threads)
        wait()

    return search


@functools.cache
def persistent_contact(composition: Composition, method: Any, parts: ContactParts, blocks: int):
    """Compose the kernel that takes many substeps of one stage each, with contact forces, in one launch.

    It is for a single world on a GPU whose bodies are all closed, in a cluster of `blocks` blocks. `steps` has the
    steps of two substeps.
    """
    dim, scalar = composition.dim, composition.scalar
    _, SceneData, *_ = tools(composition)
    Data, Pairs, Numbers = BodyContactData(scalar, False), NearPairs(scalar), ContactNumbers(scalar)
    begin, masked_particles = beginning(composition), bool(composition.selective)
    moving, timed = composition.collider_term.moving, composition.timed
    force_at, lanes = composition.force_algorithm.force_at, composition.force_algorithm.lanes
    Step = method(composition).Step
    advance, load = by_first_lane(composition, method)
    say_where = on_device(Step, arrays_of(Step, composition.compensated))
    place = as_function(place_vertices(dim, scalar, composition.compensated))
    search = search_in_launch(scalar, parts.inner)
    composed = scalar, parts.overlapping_at_start, parts.lanes
    count_touches = as_function(count_contacts(*composed))
    evaluate = as_function(evaluate_contact(*composed, False, parts.limited))
    watch = as_function(find_alarm(scalar))

    def take_substeps(
        scene: SceneData,
        steps: wp.array(dtype=Step),
        count: int,
        connection_count: int,
        threads: int,
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        numbers: Numbers,
        buffer: wp.array(dtype=scalar),
        flags: wp.array(dtype=float),
        none: wp.array(dtype=wp.float64),  # empty
    ):
        thread = grid_thread()
        h = numbers.h
        dt = float(numbers.h)
        behind, per_unit = numbers.behind, numbers.per_unit
        ahead, more, beyond = numbers.ahead, numbers.more, numbers.beyond
        if wp.static(moving):
            first = int(scene.colliders.substep)
        if wp.static(timed):
            first_stage = int(scene.stage)
        for k in range(count):
            step = steps[k % 2]
            say_where(step)
            if wp.static(timed):
                scene.stage = first_stage + k
            if wp.static(moving):
                scene.colliders.substep = first + k
            if wp.static(begin is not None):
                c = thread
                while c < connection_count:
                    begin(scene, step.compensation, step.x, c)
                    c += threads
            shift = step.compensation
            place(data, tree, shift, step.x, step.v, 0.0, dt, ahead, buffer, more, beyond, threads, 0, 1, flags)
            wait()
            # Equal for all threads: it changes only after the search's first barriers.
            if data.neighbors.due[0] != 0:
                search(data, tree, pairs, numbers, buffer, flags, threads)
            if wp.static(parts.inner):
                watch(data, pairs, numbers.apart, h, threads, 0, 1, flags)
            if wp.static(parts.limited):
                count_touches(data, h, behind, per_unit, buffer, threads, 0, 1, flags, none, none)
                wait()
            evaluate(data, h, behind, per_unit, buffer, threads, 0, 1, flags, none, none)
            wait()
            i = thread / wp.static(lanes)
            while i < scene.inverse_mass.shape[0]:
                force = force_at(scene.forces, step.compensation, step.x, step.v, i)
                mask = wp.uint8(0)
                if wp.static(masked_particles):
                    mask = scene.effect_mask[i]
                advance(scene, step, force + load(scene, step.compensation, step.x, step.v, i, mask), i)
                i += threads / wp.static(lanes)
            wait()

    return kernel(take_substeps, launch_bounds=MOST_THREADS, cluster_dim=blocks)
