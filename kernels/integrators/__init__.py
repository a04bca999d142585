"""Integration methods: the composition of kernels, and the stages of methods."""

from .composition import Composition, beginning, scene, tools
from .conjugate_gradients import conjugate_gradients
from .differences import EACH, SHARED, UNIFORM, Differences
from .euler import explicit_euler, extrapolated_leapfrog, kick, symplectic_euler
from .implicit import block_inverses, implicit_finish, impulse, mass_product
from .mid_velocity import inverse_of_kick, velocity_force
from .persistent import MOST_THREADS, NOTHING_BEFORE, persistent
from .persistent_contact import ContactNumbers, ContactParts, contact_before
from .runge_kutta import chebyshev, rk4
from .shared_memory import MOST_BYTES, on_chip_worlds
from .stages import begin_each_connection, each_column, each_connection, each_masked, each_particle, force_on_each
