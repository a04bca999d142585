"""Substeps on a device: a constant `Model`, a moving `State`, effects, launches by `Dynamics`, and diagnostics.

Only this room composes the kernels that move particles. It also launches them, except that linearly implicit Euler
launches its own solver.
"""

from .adjoint.adjoint import Adjoint, without_adjoint
from .adjoint.stage_adjoint import StageAdjoint
from .adjoint.tangent import Tangent
from .adjoint.tape import Tape
from .collision.body_contact import BodyContact
from .collision.contact_forces import ContactForces
from .collision.penetration_depth import outward_normals, start_depths, touching
from .diagnostics.divergence_monitor import Backup, Baseline, DivergenceMonitor, FrozenWorlds, WorldStatus
from .diagnostics.energies import Measures, measure, write_in_order, write_strain
from .diagnostics.energy_balance import (
    EnergyBalance,
    EnergySums,
    is_told_by_frames,
    potential,
    rounding_energy,
    size,
    weight,
)
from .diagnostics.probes import GroupMeans, Sensors, measure_substep, sensors_of
from .diagnostics.rate_bounds import (
    Rates,
    functions_of,
    own_rates,
    rate_bounds,
    rates_by_part,
    resists,
    world_rates,
)
from .diagnostics.readout import Found
from .diagnostics.time_scales import LOOK, time_rates
from .model.effect import Effect, Steps
from .model.model import Model
from .model.state import State, copy_vectors
from .springs.linearised import add_linearised, write_diagonal_blocks
from .stepping.assemble import Assembly, assemble, assemble_worlds
from .stepping.dynamics import Dynamics
from .stepping.stages import Solve, Stage
from .stepping.start_checks import caught, starting_state, warn_of_start
from .stepping.substeps import Blocks, Stepper, check_blocks
from .stepping.velocities import Velocities, kicked
from .stepping.world_differences import threads_of_world
