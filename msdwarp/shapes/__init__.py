"""Functions that create systems: lattices, round solids, outlines, meshes, joined bodies; sections of bodies."""

from .joining import join
from .lattices import box, chain, lattice, sheet
from .meshes import from_mesh
from .outlines import cloth
from .rods import rod
from .sections import Section
from .shells import disc, icosphere, shell
from .solids import ball, cone, cylinder
from .viscoelastic import viscoelastic
from .volumes import from_volume
from .voxels import voxel_corners, voxels
