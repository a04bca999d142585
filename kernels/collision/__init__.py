"""Bodies that touch: points of their surfaces against triangles, found by lists, held apart by springs."""

from .body_contact import contact_energy, evaluate_contact
from .bounding_boxes import box_facets, box_neighbours, clear_boxes, find_roots
from .contact_impulses import add_impulses
from .contact_surfaces import (
    DEEPEST,
    FLAGS,
    HISTORY,
    LONGEST_ROW,
    MOST_BODY_PAIRS,
    MOVED,
    WAY,
    Surfaces,
    body_contact_term,
)
from .lanes import BLOCK, BLOCKS, FEW_ON_GPU, ON_GPU
from .nearest_point import nearest_on_triangle
from .neighbor_search import find_candidates, find_rows, range_of_speeds
from .segments_and_spheres import evaluate_segments_and_spheres
from .surface_contact import evaluate_surface
from .surface_contact_data import (
    QUADRATURE_POINTS,
    SurfaceContactData,
    add_energies,
    add_pushes,
    quadrature_weights,
    surface_contact_term,
)
from .tunnelling import COUNT, FACET, GAP, NOTED, PLACE, POINT, SPEED
from .vertices import place_vertices

__all__ = [
    "BLOCK",
    "BLOCKS",
    "COUNT",
    "DEEPEST",
    "FACET",
    "FEW_ON_GPU",
    "FLAGS",
    "GAP",
    "HISTORY",
    "LONGEST_ROW",
    "MOST_BODY_PAIRS",
    "MOVED",
    "NOTED",
    "ON_GPU",
    "PLACE",
    "POINT",
    "QUADRATURE_POINTS",
    "SPEED",
    "WAY",
    "SurfaceContactData",
    "Surfaces",
    "add_energies",
    "add_impulses",
    "add_pushes",
    "body_contact_term",
    "box_facets",
    "box_neighbours",
    "clear_boxes",
    "contact_energy",
    "evaluate_contact",
    "evaluate_segments_and_spheres",
    "evaluate_surface",
    "find_candidates",
    "find_roots",
    "find_rows",
    "nearest_on_triangle",
    "place_vertices",
    "quadrature_weights",
    "range_of_speeds",
    "surface_contact_term",
]
