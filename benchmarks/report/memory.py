"""How many bytes the report's mattress takes on the device, by algorithm, beside the report's count (table 1)."""

from typing import Any

from msdwarp import Simulation, box

from .panels import row


def stored(options: Any) -> list[dict]:
    """Count the bytes that the mattress of 20 × 7 × 2 takes on the device, by algorithm, in float32 (table 1)."""
    rows, body = [], box((20, 7, 2), stiffness=5000.0, damping=20.0)
    n, m = body.particle_count, body.connection_count
    for force_algorithm in ("scatter", "gather", "stencil"):
        simulation = Simulation(body, force_algorithm=force_algorithm, device=options.device)
        model, forces = simulation.model, simulation.stepping.dynamics.scene.forces
        instants = (simulation.state.state_in, simulation.state.state_out)
        of_forces = {
            name: getattr(forces, name) for name in ("f", "mask", "first", "other") if hasattr(forces, name)
        }
        constants = getattr(forces, "constants", None)
        kind = getattr(constants, "kind", None)
        moving = sum(array._ref.capacity for instant in instants for array in (instant.x, instant.v))
        moving -= 4 * 2 * model.margin * 16  # what a stencil may read beyond either end
        force = of_forces["f"]._ref.capacity if "f" in of_forces else 0
        mask = of_forces["mask"].capacity if "mask" in of_forces else 0
        pairs = {
            "scatter": model.connections.capacity,
            "gather": sum(of_forces[name].capacity for name in ("first", "other") if name in of_forces),
            "stencil": 0,
        }[force_algorithm]
        backup = sum(array._ref.capacity for array in simulation.stepping.backup.kept) - 4 * model.margin * 16
        found = {
            "position and velocity, twice, per particle": moving / n,
            "force, per particle": force / n,
            "bits of neighbours, per particle": mask / n,
            "1 / mass, in all": model.inverse_mass._ref.capacity,
            "who is joined, per connection": pairs / m,
            "which constants, per connection": (kind.capacity if kind is not None else 0) / m,
            "stiffness, in all": model.stiffness._ref.capacity,
            "damping, in all": model.damping._ref.capacity,
            "kept beside a substep, per connection": (
                model.rest_length.capacity + (0 if force_algorithm == "scatter" else model.connections.capacity)
            )
            / m,
            "kept beside a substep, per particle": backup / n,
            "arrays of a substep, in all": moving
            + force
            + mask
            + pairs
            + (kind.capacity if kind is not None else 0),
        }
        rows += [row("table 1", f"{force_algorithm}: {name}", value, "bytes") for name, value in found.items()]
    rows.append(row("table 1", "report: per particle", 4 * 13, "bytes"))
    rows.append(row("table 1", "report: per connection", 4 * 5, "bytes"))
    rows.append(row("table 1", "report: in all", 4 * 13 * n + 4 * 5 * m, "bytes"))
    rows.append(row("table 1", "mattress: particles", n))
    rows.append(row("table 1", "mattress: connections", m))
    return rows
