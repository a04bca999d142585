"""Ways to make a system: lattices, round solids, outlines, meshes, and several of them joined."""

from .joining import join
from .lattices import box, chain, lattice, sheet
from .meshes import from_mesh
from .outlines import cloth
from .shells import icosphere, shell
from .solids import ball, cone, cylinder

__all__ = [
    "ball",
    "box",
    "chain",
    "cloth",
    "cone",
    "cylinder",
    "from_mesh",
    "icosphere",
    "join",
    "lattice",
    "sheet",
    "shell",
]
