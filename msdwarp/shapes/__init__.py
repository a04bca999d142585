"""Functions that create systems: lattices, round solids, outlines, meshes, and joined bodies."""

from .joining import join as join
from .lattices import box as box, chain as chain, lattice as lattice, sheet as sheet
from .meshes import from_mesh as from_mesh
from .outlines import cloth as cloth
from .rods import rod as rod
from .shells import icosphere as icosphere, shell as shell
from .solids import ball as ball, cone as cone, cylinder as cylinder
from .viscoelastic import viscoelastic as viscoelastic
from .volumes import from_volume as from_volume
