"""Contact between small bodies within a launch of many substeps: all contact kernels become parts of one kernel.

`engine/stepping/contact_launch.py` decides when to use it.
"""

import functools
from typing import Any

import warp as wp

from ..basis import as_function
from ..collision.body_contact import evaluate_contact
from ..collision.contact_data import BodyContactData, NearPairs
from ..collision.facet_tree import FacetTree, begin_search, box_facets, box_neighbours
from ..collision.near_pairs import clear_pairs
from ..collision.neighbor_search import find_candidates, find_rows, range_of_speeds
from ..collision.pair_gaps import find_alarm
from ..collision.pair_search import find_near_facets, find_pairs, list_tests
from ..collision.vertices import place_vertices
from ..threads import Part, wait
from .composition import Composition, tools
from .persistent import Before

SEARCH_LANES = 8
"""Threads per point in a search; a cluster has too few threads for more."""


@functools.cache
def ContactNumbers(scalar: type):
    """Compose the struct of all arguments of the contact kernels, under the names of their parameters."""

    @wp.struct
    class ContactNumbers:
        h: scalar  # length of a substep [s]
        rate: scalar
        per_unit: wp.float64
        ahead: float
        soon: float
        most: float
        beyond: float
        farthest: scalar
        activation: scalar

    return ContactNumbers


@functools.cache
def search_in_launch(scalar: type):
    """Compose (data, tree, pairs, numbers, buffer, flags, threads): build the lists for the current vertices."""
    Data, Pairs, Numbers = BodyContactData(scalar), NearPairs(scalar), ContactNumbers(scalar)
    lanes = SEARCH_LANES
    begin, clear = as_function(begin_search(scalar)), as_function(clear_pairs(scalar))
    box, neighbours = as_function(box_facets(scalar, lanes)), as_function(box_neighbours(scalar, lanes))
    candidates, rows = as_function(find_candidates(scalar)), as_function(find_rows(scalar, lanes))
    near, tests = as_function(find_near_facets(scalar, True)), as_function(list_tests(scalar))
    test = as_function(find_pairs(scalar, False))
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
        begin(data, tree, buffer, numbers.soon, numbers.most, 0.0, 0, threads)
        clear(pairs, threads)
        wait()
        box(data, tree, threads)
        wait()
        neighbours(data, tree, wp.uint64(0), numbers.farthest, threads, flags)
        wait()
        candidates(data, tree, numbers.farthest, threads, 0, 1)
        wait()
        rows(data, tree, numbers.farthest, threads, 0, 1, flags)
        near(data, tree, pairs, numbers.activation, 1, threads, 0, 1, flags)
        wait()
        tests(data, pairs, numbers.activation, threads, 0, 1, flags)
        wait()
        test(data, pairs, numbers.activation, threads, 0, 1, flags)
        wait()
        speeds(data, threads)
        wait()

    return search


@functools.cache
def contact_before(composition: Composition, method: Any, overlapping_at_start: bool, lanes: int) -> Before:
    """Compose what `persistent` does before forces: contact between bodies, with its searches.

    It is for a single world on a GPU whose bodies are all solid, and for methods of one stage. Each point has
    `lanes` threads when forces are evaluated.
    """
    dim, scalar = composition.dim, composition.scalar
    SceneData, Step = tools(composition).SceneData, method(composition).Step
    Data, Pairs, Numbers = BodyContactData(scalar), NearPairs(scalar), ContactNumbers(scalar)
    place = as_function(place_vertices(dim, scalar, composition.compensated))
    search = search_in_launch(scalar)
    evaluate = as_function(evaluate_contact(scalar, overlapping_at_start, lanes))
    watch = as_function(find_alarm(scalar))

    @wp.struct
    class ContactInLaunch:
        data: Data
        tree: FacetTree
        pairs: Pairs
        numbers: Numbers
        buffer: wp.array(dtype=scalar)
        flags: wp.array(dtype=float)
        none: wp.array(dtype=wp.float64)  # empty

    @wp.func
    def meet(contact: ContactInLaunch, scene: SceneData, step: Step, part: Part):
        data, tree, pairs, numbers = contact.data, contact.tree, contact.pairs, contact.numbers
        buffer, flags, none, threads = contact.buffer, contact.flags, contact.none, part.stride
        h, rate, per_unit = numbers.h, numbers.rate, numbers.per_unit
        beyond, shift, dt = numbers.beyond, step.compensation, float(h)
        place(data, shift, step.x, step.v, 0.0, dt, numbers.ahead, buffer, beyond, 1, threads, 0, 1, flags)
        wait()
        # Equal for all threads: it changes only after the search's first barriers.
        if data.neighbors.due[0] != 0:
            search(data, tree, pairs, numbers, buffer, flags, threads)
        watch(data, pairs, numbers.activation, h, threads, 0, 1, flags)
        evaluate(data, h, rate, per_unit, buffer, threads, 0, 1, flags, none, none)
        wait()

    return Before(ContactInLaunch, meet)
