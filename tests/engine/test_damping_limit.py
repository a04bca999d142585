"""Dampers of contacts that limit themselves: what steps that allows, and that no step makes energy of them."""

import warnings

import numpy as np
import pytest
from played import build

from msdwarp import (
    Contact,
    Plane,
    Scene,
    Simulation,
    System,
    ball,
    box,
    cloth,
    sheet,
)
from msdwarp.engine.collision.body_contact import DAMPING


def heap() -> System:
    """Return a block, a ball cut from a lattice and a light cloth, each above the one before."""
    low = box((4, 4, 2), 0.1, mass=0.02, stiffness=2000.0, damping=1.0).pin(range(16))
    middle = ball(0.12, 0.06, mass=0.01, stiffness=1500.0, damping=0.5).translate((0.03, 0.01, 0.2))
    cloth = sheet((9, 9), 0.06, mass=0.001, stiffness=50.0, damping=0.005).translate((0, 0, 0.36))
    return low + middle + cloth


def lying(device: str) -> Simulation:
    """Return a heap that has fallen together, with strong dampers, at its automatic substeps."""
    contact = Contact(restitution=0.05, friction=0.5)
    simulation = Simulation(heap(), contact=contact, device=device, precision="float64")
    simulation.step(40)
    return simulation


def contact_forces(simulation: Simulation, velocity: np.ndarray) -> np.ndarray:
    """Return the forces of contacts in the present places for given velocities [N], shape [particle_count, 3]."""
    effect, model = simulation.assembly.body_contact, simulation.model
    v = model.vectors()
    v.assign(model.spread(velocity[None].astype(model.dtype)))
    x = simulation.stepping.state.x
    effect.search(x, v, None, 0.0, False, True)
    effect.before_forces(x, v, None, False)
    on_vertices = effect._data.surfaces.force.numpy() * effect.data.unit
    surfaces, found = effect.surfaces.on_host, np.zeros_like(velocity)
    for k in range(surfaces.particle.shape[1]):
        np.add.at(found, surfaces.particle[:, k], surfaces.weight[:, k, None] * on_vertices)
    return found


@pytest.mark.slow
def test_no_rate_of_all_dampers_together_exceeds_the_limit(plain_device):
    simulation = lying(plain_device)
    system = simulation.snapshot()
    inverse = 1.0 / system.mass[:, None]
    # The force of contacts is linear in small velocities: power iteration finds the largest rate of the dampers.
    at_rest = contact_forces(simulation, np.zeros_like(system.position))
    assert np.count_nonzero(at_rest.any(axis=1)) > 20
    v, rate = np.random.default_rng(1).normal(size=system.position.shape) * (inverse > 0), 0.0
    for _ in range(60):
        v *= 1e-6 / np.linalg.norm(v)
        v = inverse * (at_rest - contact_forces(simulation, v))
        rate = np.linalg.norm(v) / 1e-6
    step = 1.0 / (simulation.fps * simulation.substeps)
    # Forces are rounded to units of 2⁻⁴⁰ of the largest: to 1e-4 of those that 1e-6 m/s cause.
    # The points at a vertex share DAMPING / h, and those that press on it as much; each damper acts on two sides.
    assert 0.5 * DAMPING < rate * step < 4.0 * DAMPING


@pytest.mark.slow
def test_energy_only_falls_at_few_substeps(plain_device):
    simulation = Simulation(
        heap(),
        contact=Contact(restitution=0.05, friction=0.5),
        colliders=[Plane(offset=-1.0)],
        device=plain_device,
    )
    energies = []
    for _ in range(25):
        simulation.step()
        energies.append(simulation.measure().energy)
    # What a first-order method's energy swings by, while fast modes ring: less than 1e-3 of what falls.
    assert np.diff(energies).max() < 1e-3 * (energies[0] - energies[-1])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most"), [("tower", 1.25), ("curtain", 1.45)])
def test_contact_asks_for_few_more_substeps(name, most):
    scene = build(name)
    alone = Scene(**{field: getattr(scene, field) for field in ("system", "colliders", "loads", "schedule")})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        counts = [Simulation.from_scene(one, device="cpu").substeps for one in (scene, alone)]
    assert counts[0] <= most * counts[1]


def test_a_cloth_with_a_pinned_rim_has_a_bound():
    # Some vertices of its round border lie outside of their cells: free particles have negative weights there.
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    outline = 0.6 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    mat = cloth(outline, 0.06, mass=0.004, stiffness=400.0, damping=0.15)
    mat = mat.pin(np.linalg.norm(mat.position[:, :2], axis=1) > 0.54)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation = Simulation(mat + mat.translate((0, 0, 0.3)), contact=Contact(), device="cpu")
    assert simulation.substeps > 0
