"""Contact between bodies: points on their surfaces against triangles, found with neighbor lists."""

from .body_contact import (
    contact_energy as contact_energy,
    count_contacts as count_contacts,
    evaluate_contact as evaluate_contact,
)
from .contact_data import (
    ACTIVE as ACTIVE,
    DEEPEST as DEEPEST,
    FLAGS as FLAGS,
    FORCED as FORCED,
    HELD_BACK as HELD_BACK,
    HISTORY as HISTORY,
    LONGEST_ROW as LONGEST_ROW,
    MOST_BODY_PAIRS as MOST_BODY_PAIRS,
    MOVED as MOVED,
    PAIRS as PAIRS,
    STORED as STORED,
    WAY as WAY,
    BodyContactData as BodyContactData,
    NearPairs as NearPairs,
    Pair as Pair,
    body_contact_term as body_contact_term,
)
from .division_planes import (
    MOST_THREADS as MOST_THREADS,
    PHASES as PHASES,
    ROUNDS as ROUNDS,
    catch_up as catch_up,
    end_round as end_round,
    keep_apart as keep_apart,
)
from .facet_tree import (
    FacetTree as FacetTree,
    begin_search as begin_search,
    box_facets as box_facets,
    box_neighbours as box_neighbours,
    find_roots as find_roots,
)
from .force_sums import add_impulses as add_impulses
from .near_pairs import clear_pairs as clear_pairs
from .nearest_point import nearest_on_triangle as nearest_on_triangle
from .neighbor_search import (
    BLOCK as BLOCK,
    BLOCKS as BLOCKS,
    FEW_ON_GPU as FEW_ON_GPU,
    GRAINS_ON_GPU as GRAINS_ON_GPU,
    MANY_ON_GPU as MANY_ON_GPU,
    MOST_BY_MORE as MOST_BY_MORE,
    ON_GPU as ON_GPU,
    find_candidates as find_candidates,
    find_rows as find_rows,
    range_of_speeds as range_of_speeds,
)
from .pair_gaps import find_alarm as find_alarm, measure_pairs as measure_pairs
from .pair_search import (
    QUEUES as QUEUES,
    SHARES as SHARES,
    find_pairs as find_pairs,
    find_pairs_of_pieces as find_pairs_of_pieces,
)
from .segments_and_spheres import (
    evaluate_segments_and_spheres as evaluate_segments_and_spheres,
    find_rows_of_grains as find_rows_of_grains,
)
from .surface_contact import evaluate_surface as evaluate_surface
from .surface_contact_data import (
    QUADRATURE_POINTS as QUADRATURE_POINTS,
    SurfaceContactData as SurfaceContactData,
    add_energies as add_energies,
    add_pushes as add_pushes,
    quadrature_weights as quadrature_weights,
    surface_contact_term as surface_contact_term,
)
from .tangles import find_tangles as find_tangles
from .vertices import (
    TearingFacets as TearingFacets,
    leave_out_torn as leave_out_torn,
    place_inner as place_inner,
    place_vertices as place_vertices,
)
