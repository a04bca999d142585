"""Systems of particles joined by springs and dampers, as NumPy arrays on the host."""

from .angles import Angles
from .cells import CORNERS, FACES, NONE, Cells
from .connectivity import CORNER_STEPS, corner_pairs, pieces
from .contact_surfaces import (
    TouchingSurfaces,
    behind_surfaces,
    contact_surfaces,
    facet_moments,
    spring_means,
    without_surface,
)
from .dampers import LINEAR, CoulombDamper, Damper, OwnDamper, QuadraticDamper, UnknownDamper
from .device_functions import check_types
from .facets import Facets, facets_of, open_edges, sides_of
from .fields import (
    CONNECTION_FIELDS,
    DEFAULTS,
    LIMITS,
    PARTICLE_FIELDS,
    TEARING_FIELDS,
    break_stretch,
    lengths,
    scaled_parts,
)
from .frame import Frame, Series
from .materials import CORK, COTTON, FOAM, JELLY, MUSCLE, RUBBER, SILICONE, STEEL_WIRE, Material
from .numbering import places_along_curve, space_filling_order
from .regions import DamperKinds, LawKinds, SpringKinds, cell_part, each_law, joined_laws
from .selection import body_name, mask_of, particles_meant
from .space import AXES, in_space, rotated, rotation, rotations
from .springs import (
    LINEAR_SPRING,
    ExponentialSpring,
    LimitedSpring,
    OwnSpring,
    PolynomialSpring,
    Spring,
    TensionOnlySpring,
    UnknownSpring,
)
from .stress import connection_fractions, stress, von_mises
from .surface import Surface
from .system import System, headline
from .torn_surfaces import Bare, Edges, broken_before, cells_of, connection_between, laid_bare
from .uniform import counted, is_uniform, joined, stored, uniform, uniform_like
