"""Systems of particles joined by springs and dampers, as NumPy arrays on the host."""

from .angles import Angles as Angles
from .cells import CORNERS as CORNERS, NONE as NONE, Cells as Cells
from .connectivity import pieces as pieces
from .contact_surfaces import (
    TouchingSurfaces as TouchingSurfaces,
    behind_surfaces as behind_surfaces,
    contact_surfaces as contact_surfaces,
    spring_means as spring_means,
)
from .dampers import (
    LINEAR as LINEAR,
    CoulombDamper as CoulombDamper,
    Damper as Damper,
    OwnDamper as OwnDamper,
    QuadraticDamper as QuadraticDamper,
    UnknownDamper as UnknownDamper,
)
from .device_functions import check_types as check_types
from .facets import Facets as Facets, facets_of as facets_of, open_edges as open_edges, sides_of as sides_of
from .fields import (
    CONNECTION_FIELDS as CONNECTION_FIELDS,
    DEFAULTS as DEFAULTS,
    LIMITS as LIMITS,
    PARTICLE_FIELDS as PARTICLE_FIELDS,
    TEARING_FIELDS as TEARING_FIELDS,
    break_stretch as break_stretch,
    lengths as lengths,
    scaled_parts as scaled_parts,
)
from .frame import Frame as Frame, Series as Series
from .law_kinds import (
    DamperKinds as DamperKinds,
    LawKinds as LawKinds,
    SpringKinds as SpringKinds,
    each_law as each_law,
    joined_laws as joined_laws,
)
from .materials import (
    CORK as CORK,
    COTTON as COTTON,
    FOAM as FOAM,
    JELLY as JELLY,
    MUSCLE as MUSCLE,
    RUBBER as RUBBER,
    SILICONE as SILICONE,
    STEEL_WIRE as STEEL_WIRE,
    Material as Material,
)
from .numbering import places_along_curve as places_along_curve, space_filling_order as space_filling_order
from .selection import body_name as body_name, mask_of as mask_of
from .space import (
    AXES as AXES,
    in_space as in_space,
    rotated as rotated,
    rotation as rotation,
    rotations as rotations,
)
from .springs import (
    LINEAR_SPRING as LINEAR_SPRING,
    ExponentialSpring as ExponentialSpring,
    LimitedSpring as LimitedSpring,
    OwnSpring as OwnSpring,
    PolynomialSpring as PolynomialSpring,
    Spring as Spring,
    TensionOnlySpring as TensionOnlySpring,
    UnknownSpring as UnknownSpring,
)
from .stress import connection_shares as connection_shares, stress as stress, von_mises as von_mises
from .surface import Surface as Surface
from .system import (
    System as System,
    counted as counted,
    headline as headline,
    particles_meant as particles_meant,
)
from .torn_surfaces import (
    Bare as Bare,
    Edges as Edges,
    broken_before as broken_before,
    cells_of as cells_of,
    connection_between as connection_between,
    laid_bare as laid_bare,
)
from .uniform import (
    is_uniform as is_uniform,
    joined as joined,
    stored as stored,
    uniform as uniform,
    uniform_like as uniform_like,
)
