"""Bodies that touch: points of their surfaces against triangles, found by lists, held apart by springs."""

from .boxes import box_facets, box_neighbours, find_roots, forget_boxes
from .evaluate import energy_of_touch, place_vertices, touch
from .felt import add_impulses
from .lanes import BLOCK, BLOCKS, FEW_ON_GPU, ON_GPU
from .nearest import nearest_on_triangle
from .overrun import COUNT, FACET, GAP, NOTED, PLACE, POINT, SPEED
from .search import find_candidates, find_rows, range_of_speeds
from .slender import touch_slender
from .straddle import straddle
from .straddled import PLACES, Straddled, add_energies, add_pushes, straddling_piece, weights_of_places
from .surfaces import DEEPEST, FLAGS, HISTORY, LONGEST_ROW, MOST_BESIDE, MOVED, WAY, Surfaces, touching_piece

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
    "MOST_BESIDE",
    "MOVED",
    "NOTED",
    "ON_GPU",
    "PLACE",
    "PLACES",
    "POINT",
    "SPEED",
    "WAY",
    "Straddled",
    "Surfaces",
    "add_energies",
    "add_impulses",
    "add_pushes",
    "box_facets",
    "box_neighbours",
    "energy_of_touch",
    "find_candidates",
    "find_roots",
    "find_rows",
    "forget_boxes",
    "nearest_on_triangle",
    "place_vertices",
    "range_of_speeds",
    "straddle",
    "straddling_piece",
    "touch",
    "touch_slender",
    "touching_piece",
    "weights_of_places",
]
