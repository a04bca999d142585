"""What moves: systems of particles joined by springs and dampers, as NumPy arrays. Knows of no device."""

from .cells import Bare, laid_bare
from .connectivity import pieces
from .contact_surfaces import TouchingSurfaces, contact_surfaces, mean_stiffness
from .dampers import LINEAR, CoulombDamper, Damper, QuadraticDamper
from .facets import Facets, facets_of, open_edges
from .fields import CONNECTION_FIELDS, DEFAULTS, PARTICLE_FIELDS, TEARING_FIELDS
from .frame import Frame, Series
from .materials import COTTON, FOAM, JELLY, RUBBER, STEEL_WIRE, Material
from .numbering import places_along_curve, space_filling_order
from .space import AXES, in_space, rotated, rotation, rotations
from .surface import Surface
from .surface_splitting import Edges, broken_before
from .system import System, headline, particles_meant
from .text import counted
from .uniform import is_uniform, joined, stored, uniform, uniform_like

__all__ = [
    "AXES",
    "CONNECTION_FIELDS",
    "COTTON",
    "DEFAULTS",
    "FOAM",
    "JELLY",
    "LINEAR",
    "PARTICLE_FIELDS",
    "RUBBER",
    "STEEL_WIRE",
    "TEARING_FIELDS",
    "Bare",
    "CoulombDamper",
    "Damper",
    "Edges",
    "Facets",
    "Frame",
    "Material",
    "QuadraticDamper",
    "Series",
    "Surface",
    "System",
    "TouchingSurfaces",
    "broken_before",
    "contact_surfaces",
    "counted",
    "facets_of",
    "headline",
    "in_space",
    "is_uniform",
    "joined",
    "laid_bare",
    "mean_stiffness",
    "open_edges",
    "particles_meant",
    "pieces",
    "places_along_curve",
    "rotated",
    "rotation",
    "rotations",
    "space_filling_order",
    "stored",
    "uniform",
    "uniform_like",
]
