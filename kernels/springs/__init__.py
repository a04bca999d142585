"""Springs: the law of a connection (`law`), and the algorithms that sum the forces on a particle.

An algorithm names a struct (`Forces`) of what its kernels read, and a function `force_at` that returns the force
on a particle. Scattered forces (`scatter`) are evaluated beforehand, connection by connection; gathered ones where
they are asked for, from a table of neighbours (`gather`) or, in a lattice, by counting (`stencil`). Positions are
x − lost.x in compensated precision: what rounding took matters to short springs.
"""

from .constants import CONSTANTS, KIND_SHIFT, MOST_KINDS
from .dampers import Law, damper_force
from .force_algorithm import ForceAlgorithm
from .fracture import NO_SUBSTEP, Breaking, breaking, leave_out_broken
from .gather import CHUNK, SLICE, gather
from .lanes import MOST_NEIGHBOURS, gather_of_lanes, lane_of, stencil_of_lanes
from .linearised import add_blocks
from .plasticity import plastic_flow, yielding
from .scatter import scatter
from .stencil import COLUMN, stencil, stencil_rows

__all__ = [
    "CHUNK",
    "COLUMN",
    "CONSTANTS",
    "KIND_SHIFT",
    "MOST_KINDS",
    "MOST_NEIGHBOURS",
    "NO_SUBSTEP",
    "SLICE",
    "Breaking",
    "ForceAlgorithm",
    "Law",
    "add_blocks",
    "breaking",
    "damper_force",
    "gather",
    "gather_of_lanes",
    "lane_of",
    "leave_out_broken",
    "plastic_flow",
    "scatter",
    "stencil",
    "stencil_of_lanes",
    "stencil_rows",
    "yielding",
]
