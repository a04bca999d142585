"""Loads: forces on particles besides spring forces, each a term in a scene's kernels."""

from .actuators import actuated_springs, add_tension
from .attachments import attachments
from .drives import driven
from .forces import (
    APART,
    add_function_slopes,
    function_force,
    function_projection,
    function_values,
    given_force_projection,
    steady_force,
    varying_force,
    weight_force,
)
from .pressure import gas_adjoint, gas_law, gas_pressure, given_pressure, given_projection
from .surface_triangles import mix_vertices, mixed_vertices
from .wind import projection_on_faces, projection_on_particles, velocity_of_air, wind_on_faces, wind_on_particles
from .work import NOTHING, add_work, measured, sum_work, work
