"""Loads: forces on particles besides spring forces, each a term in a scene's kernels."""

from .actuators import actuated_springs as actuated_springs, add_tension as add_tension
from .attachments import attachments as attachments
from .drives import driven as driven
from .forces import (
    APART as APART,
    add_function_slopes as add_function_slopes,
    function_force as function_force,
    function_projection as function_projection,
    function_values as function_values,
    given_force_projection as given_force_projection,
    steady_force as steady_force,
    varying_force as varying_force,
    weight_force as weight_force,
)
from .pressure import (
    gas_adjoint as gas_adjoint,
    gas_law as gas_law,
    gas_pressure as gas_pressure,
    given_pressure as given_pressure,
    given_projection as given_projection,
)
from .surface_triangles import mix_vertices as mix_vertices, mixed_vertices as mixed_vertices
from .wind import (
    projection_on_faces as projection_on_faces,
    projection_on_particles as projection_on_particles,
    velocity_of_air as velocity_of_air,
    wind_on_faces as wind_on_faces,
    wind_on_particles as wind_on_particles,
)
from .work import (
    NOTHING as NOTHING,
    add_work as add_work,
    measured as measured,
    sum_work as sum_work,
    work as work,
)
