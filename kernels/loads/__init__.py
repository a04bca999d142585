"""Loads: what acts on particles beside a route's forces, each a piece that a scene's kernels are composed with."""

from ..springs.extra_springs import tie_force
from .actuators import actuated_springs, add_tension
from .attachments import attachments
from .drives import driven
from .forces import function_force, steady_force, varying_force, weight_force
from .pressure import gas_law, gas_pressure, given_pressure
from .surface_triangles import mix_vertices, mixed_vertices
from .wind import wind_on_faces, wind_on_particles
from .work import NOTHING, add_work, measured, sum_work, work

__all__ = [
    "NOTHING",
    "actuated_springs",
    "add_tension",
    "add_work",
    "attachments",
    "driven",
    "function_force",
    "gas_law",
    "gas_pressure",
    "given_pressure",
    "measured",
    "mix_vertices",
    "mixed_vertices",
    "steady_force",
    "sum_work",
    "tie_force",
    "varying_force",
    "weight_force",
    "wind_on_faces",
    "wind_on_particles",
    "work",
]
