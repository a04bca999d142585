"""Loads: what acts on particles from outside, each a piece that a scene's kernels are composed with."""

from .drives import driven
from .forces import applied_force, function_force
from .pressure import gas_law, gas_pressure, given_pressure
from .wind import wind_on_faces, wind_on_particles
from .work import measured, sum_work, work

__all__ = [
    "applied_force",
    "driven",
    "function_force",
    "gas_law",
    "gas_pressure",
    "given_pressure",
    "measured",
    "sum_work",
    "wind_on_faces",
    "wind_on_particles",
    "work",
]
