"""What a simulation says of itself."""

from collections.abc import Sequence
from typing import Any

from ..integrators import Integrator
from ..world import Collider


def headline(simulation: Any, method: Integrator, colliders: Sequence[Collider]) -> str:
    """Say in a few lines what a `Simulation` simulates, how, and how far it is."""
    system, model = simulation.system, simulation.model
    parts = f"{system.particle_count} particles, {system.connection_count} connections"
    around = "".join(f", {type(one).__name__}" for one in colliders[:4])
    threads = f" with {simulation.threads} threads" if simulation.threads > 1 else ""
    return (
        f"<Simulation of {parts}{around}\n"
        f"  {method!r}, {simulation.substeps} substeps a frame at {simulation.fps:g} frames a second\n"
        f"  {model.precision} by {model.force_algorithm} on {simulation.device}{threads}\n"
        f"  at {simulation.time:.4g} s, frame {simulation.frame_index}>"
    )
