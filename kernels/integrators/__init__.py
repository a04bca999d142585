"""Integration methods: the composition of kernels, and the stages of methods."""

from .composition import (
    Composition as Composition,
    beginning as beginning,
    scene as scene,
    tools as tools,
)
from .conjugate_gradients import conjugate_gradients as conjugate_gradients
from .differences import EACH as EACH, SHARED as SHARED, UNIFORM as UNIFORM, Differences as Differences
from .euler import (
    explicit_euler as explicit_euler,
    extrapolated_leapfrog as extrapolated_leapfrog,
    kick as kick,
    symplectic_euler as symplectic_euler,
)
from .implicit import (
    block_inverses as block_inverses,
    implicit_finish as implicit_finish,
    impulse as impulse,
    mass_product as mass_product,
)
from .mid_velocity import inverse_of_kick as inverse_of_kick, velocity_force as velocity_force
from .persistent import MOST_THREADS as MOST_THREADS, NOTHING_BEFORE as NOTHING_BEFORE, persistent as persistent
from .persistent_contact import (
    ContactNumbers as ContactNumbers,
    ContactParts as ContactParts,
    contact_before as contact_before,
)
from .runge_kutta import chebyshev as chebyshev, rk4 as rk4
from .shared_memory import MOST_BYTES as MOST_BYTES, on_chip_worlds as on_chip_worlds
from .stages import (
    begin_each_connection as begin_each_connection,
    each_column as each_column,
    each_connection as each_connection,
    each_masked as each_masked,
    each_particle as each_particle,
    force_on_each as force_on_each,
)
