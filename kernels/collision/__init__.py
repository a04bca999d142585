"""Contact between bodies: points on their surfaces against triangles, found with neighbor lists."""

from .body_contact import contact_energy, count_contacts, evaluate_contact
from .contact_data import (
    ACTIVE,
    DEEPEST,
    FLAGS,
    FORCED,
    HELD_BACK,
    HISTORY,
    LONGEST_ROW,
    MOST_BODY_PAIRS,
    MOVED,
    PAIRS,
    STORED,
    WAY,
    BodyContactData,
    NearPairs,
    Pair,
    body_contact_term,
)
from .division_planes import MOST_THREADS, PHASES, ROUNDS, catch_up, end_round, keep_apart
from .facet_tree import FacetTree, begin_search, box_facets, box_neighbours, find_roots
from .force_sums import add_impulses
from .near_pairs import clear_pairs
from .nearest_point import nearest_on_triangle
from .neighbor_search import (
    BLOCK,
    BLOCKS,
    FEW_ON_GPU,
    GRAINS_ON_GPU,
    MANY_ON_GPU,
    MOST_BY_MORE,
    ON_GPU,
    find_candidates,
    find_rows,
    range_of_speeds,
)
from .pair_gaps import find_alarm, measure_pairs
from .pair_search import QUEUES, SHARES, find_pairs, find_pairs_of_pieces
from .segments_and_spheres import evaluate_segments_and_spheres, find_rows_of_grains
from .surface_contact import evaluate_surface
from .surface_contact_data import (
    QUADRATURE_POINTS,
    SurfaceContactData,
    add_energies,
    add_pushes,
    quadrature_weights,
    surface_contact_term,
)
from .tangles import find_tangles
from .vertices import TearingFacets, leave_out_torn, place_inner, place_vertices
