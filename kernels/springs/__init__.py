"""Springs: the law of a spring and its damper (`law`), and the algorithms that sum the forces on a particle.

An algorithm has a struct, `Forces`, which its kernels read, and a function `force_at` that returns the force on a
particle. Scattered forces (`scatter`) are evaluated in an earlier launch, spring by spring. Gathered forces are
evaluated by `force_at`, from a table of neighbours (`gather`) or, in a lattice, from index offsets (`stencil`). In
compensated precision positions are x − compensation.x, since rounding errors matter in short springs.
"""

from .angles import (
    angle_blocks as angle_blocks,
    angle_energies as angle_energies,
    angle_forces as angle_forces,
    angle_projection as angle_projection,
)
from .cell_volumes import (
    cell_blocks as cell_blocks,
    cell_energies as cell_energies,
    cell_forces as cell_forces,
    cell_projection as cell_projection,
    cell_table as cell_table,
    cell_volumes as cell_volumes,
    inverted_cells as inverted_cells,
)
from .constants import CONSTANTS as CONSTANTS, KIND_SHIFT as KIND_SHIFT, MOST_KINDS as MOST_KINDS
from .dampers import LINEAR as LINEAR, damper_force as damper_force, law_numbers as law_numbers
from .extra_springs import tie_force as tie_force
from .force_algorithm import ForceAlgorithm as ForceAlgorithm
from .fracture import NO_SUBSTEP as NO_SUBSTEP, breaking as breaking
from .gather import CHUNK as CHUNK, SLICE as SLICE, gather as gather
from .lanes import (
    MOST_NEIGHBOURS as MOST_NEIGHBOURS,
    gather_of_lanes as gather_of_lanes,
    lane_of as lane_of,
    stencil_of_lanes as stencil_of_lanes,
    sum_over_lanes as sum_over_lanes,
)
from .lattice_cells import (
    lattice_pressures as lattice_pressures,
    lattice_volumes as lattice_volumes,
)
from .plasticity import yielding as yielding
from .scatter import scatter as scatter
from .spring_laws import (
    Laws as Laws,
    connection_table as connection_table,
    forms_of as forms_of,
    numbers_of as numbers_of,
    spring_energy as spring_energy,
)
from .stencil import COLUMN as COLUMN, stencil as stencil, stencil_rows as stencil_rows
