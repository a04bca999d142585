"""Springs: the law of a spring and its damper (`law`), and the algorithms that sum the forces on a particle.

An algorithm has a struct, `Forces`, which its kernels read, and a function `force_at` that returns the force on a
particle. Scattered forces (`scatter`) are evaluated in an earlier launch, spring by spring. Gathered forces are
evaluated by `force_at`, from a table of neighbours (`gather`) or, in a lattice, from index offsets (`stencil`). In
compensated precision positions are x − compensation.x, since rounding errors matter in short springs.
"""

from .angles import angle_blocks, angle_energies, angle_forces, angle_projection
from .cell_volumes import (
    cell_blocks,
    cell_energies,
    cell_forces,
    cell_projection,
    cell_table,
    cell_volumes,
    inverted_cells,
)
from .constants import CONSTANTS, KIND_SHIFT, MOST_KINDS
from .dampers import LINEAR, damper_force, law_numbers
from .extra_springs import tie_force
from .force_algorithm import ForceAlgorithm
from .fracture import NO_SUBSTEP, breaking
from .gather import CHUNK, SLICE, gather
from .lanes import MOST_NEIGHBOURS, lane_of, stencil_of_lanes, sum_over_lanes
from .lattice_cells import lattice_pressures, lattice_volumes
from .plasticity import yielding
from .scatter import scatter
from .spring_laws import Laws, connection_table, forms_of, numbers_of, spring_energy
from .stencil import COLUMN, stencil, stencil_rows
