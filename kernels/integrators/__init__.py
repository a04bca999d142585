"""Methods of integration: what their kernels are composed from, and their stages."""

from .composition import Composition, Stage, Tools, beginning, loads, scene, tools
from .conjugate_gradients import conjugate_gradients
from .cpu_partition import ABORT, PartOfParticles, in_partition, wait_for_all
from .differences import EACH, SHARED, UNIFORM, Differences
from .euler import explicit_euler, extrapolated_leapfrog, kick, symplectic_euler
from .implicit import block_inverses, implicit_finish, impulse, mass_product
from .persistent import MOST_THREADS, persistent
from .runge_kutta import chebyshev, rk4
from .shared_memory import MOST_BYTES, on_chip_worlds
from .stages import (
    begin_each_connection,
    each_column,
    each_connection,
    each_masked,
    each_particle,
    finish,
    force_on_each,
    particle_acceleration,
)

__all__ = [
    "ABORT",
    "EACH",
    "MOST_BYTES",
    "MOST_THREADS",
    "SHARED",
    "UNIFORM",
    "Composition",
    "Differences",
    "PartOfParticles",
    "Stage",
    "Tools",
    "begin_each_connection",
    "beginning",
    "block_inverses",
    "chebyshev",
    "conjugate_gradients",
    "each_column",
    "each_connection",
    "each_masked",
    "each_particle",
    "explicit_euler",
    "extrapolated_leapfrog",
    "finish",
    "force_on_each",
    "implicit_finish",
    "impulse",
    "in_partition",
    "kick",
    "loads",
    "mass_product",
    "on_chip_worlds",
    "particle_acceleration",
    "persistent",
    "rk4",
    "scene",
    "symplectic_euler",
    "tools",
    "wait_for_all",
]
