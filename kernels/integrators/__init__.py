"""Methods of integration: what their kernels are composed from, and their stages."""

from .composition import Composition, world
from .conjugate_gradients import conjugate_gradients
from .euler import explicit_euler, extrapolated_leapfrog, kick, symplectic_euler
from .implicit import block_inverses, implicit_finish, impulse, mass_product
from .persistent import MOST_THREADS, persistent
from .runge_kutta import chebyshev, rk4
from .stages import each_column, each_connection, each_particle

__all__ = [
    "MOST_THREADS",
    "Composition",
    "block_inverses",
    "chebyshev",
    "conjugate_gradients",
    "each_column",
    "each_connection",
    "each_particle",
    "explicit_euler",
    "extrapolated_leapfrog",
    "implicit_finish",
    "impulse",
    "kick",
    "mass_product",
    "persistent",
    "rk4",
    "symplectic_euler",
    "world",
]
