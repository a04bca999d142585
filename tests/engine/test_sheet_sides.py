"""Sheets: what has come through one is pushed back to the side on which it was."""

import dataclasses

import numpy as np
import pytest

from msdwarp import Contact, Ensemble, Simulation, System, TunnellingWarning, sheet
from msdwarp.engine.collision import neighbor_list as nearby

SPACING, THICKNESS, STIFFNESS, MASS = 0.1, 0.01, 400.0, 1e-3
SIZE = 64
"""Particles of the sheet, which grains follow."""


def held_sheet(bumps: float = 0.0) -> System:
    """Return a sheet around the origin that is held everywhere, with bumps of at most such a height [m]."""
    bed = sheet((8, 8), SPACING, mass=0.01, stiffness=STIFFNESS, damping=0.0)
    x = bed.position - bed.position.mean(axis=0)
    x[:, 2] = bumps * np.random.default_rng(1).uniform(-1, 1, SIZE)
    return bed.replace(position=x).pin(slice(None)).named("sheet")


def grains(position: np.ndarray, velocity: np.ndarray) -> System:
    """Return single particles, each a body."""
    return System(position=position, velocity=velocity, mass=MASS).named("grains")


def thrown(speed: float, device: str = "cpu", bumps: float = 0.0, sideways: float = 0.0, **options) -> Simulation:
    """Throw 36 grains down onto a held sheet, all over it, without damping and friction, and sideways too."""
    rng = np.random.default_rng(2)
    x = np.stack(np.meshgrid(*[np.linspace(-0.22, 0.22, 6)] * 2), axis=-1).reshape(-1, 2)
    x = np.column_stack([x + rng.uniform(-0.02, 0.02, x.shape), np.full(len(x), bumps + 1.5 * THICKNESS)])
    v = np.column_stack([rng.uniform(-sideways, sideways, (len(x), 2)), np.full(len(x), -speed)])
    contact = [
        Contact(thickness=THICKNESS, stiffness=STIFFNESS, restitution=1.0, friction=0.0),
        Contact(groups=("grains", "grains"), exclude=True),
    ]
    options = {"gravity": 0.0, "device": device, "precision": "float64", "fps": 240.0} | options
    return Simulation(held_sheet(bumps) + grains(x, v), contact=contact, **options)


def held_back(simulation: Simulation) -> int:
    """Return how many points have come through and are remembered."""
    contact = simulation.assembly.body_contact
    surfaces, seen = contact.surfaces.on_host, contact.history.data.contact_side.numpy()
    corner, x = surfaces.corner, np.asarray(simulation.frame().position)
    slot, point = np.nonzero(seen)
    grain = surfaces.ends[point, 0]
    a, b, c = np.moveaxis(x[corner[np.abs(seen[slot, point]) - 1]], 1, 0)
    height = np.einsum("ik,ik->i", x[grain] - a, np.cross(b - a, c - a)) * np.sign(seen[slot, point])
    return int((height < 0).sum())


@pytest.mark.parametrize(("bumps", "sideways"), [(0.0, 0.0), (0.03, 1.0)], ids=["flat", "bumps"])
def test_what_comes_through_a_sheet_is_thrown_back(device, bumps, sideways):
    # By energy a grain comes v √(m/k) far past where it touches: 31 mm, of which 10 mm are the sheet's thickness.
    speed = 20.0
    simulation = thrown(speed, device, bumps, sideways)
    before = np.linalg.norm(simulation.frame().velocity[SIZE:], axis=1)
    behind = 0
    for _ in range(8):
        simulation.step()
        behind = max(behind, held_back(simulation))
    frame = simulation.frame()
    assert behind > 12  # of those that came through at a frame's end
    assert (frame.position[SIZE:, 2] > bumps).all()
    # Energy is conserved to the second order of the step, which is 1/50 of a contact's time π √(m/k): 0.1 % where
    # the sheet is flat, 0.8 % over bumps, measured from 1 to 30 m/s.
    after = np.linalg.norm(frame.velocity[SIZE:], axis=1)
    np.testing.assert_allclose(after, before, rtol=0.01 if bumps else 0.003)


@pytest.mark.slow
def test_what_comes_through_by_more_than_half_a_spacing_is_lost_and_told():
    # v √(m/k) is 76 mm: more than the thickness and half of the spacing, which are 60 mm.
    simulation = thrown(48.0, fps=960.0)
    with pytest.warns(TunnellingWarning, match="'sheet'"):
        simulation.step(8)
    assert (simulation.frame().position[SIZE:, 2] < -0.5 * SPACING).all()
    # What is not lost is not told of: 52 mm of them.
    thrown(33.0, fps=960.0).step(8)


def test_what_goes_around_the_border_is_let_go(device):
    # It slides off the sheet, whose border is at 0.35 m, and falls.
    grain = grains(np.array([[0.33, 0.02, THICKNESS]]), np.array([[1.0, 0.0, 0.0]]))
    contact = Contact(thickness=THICKNESS, stiffness=STIFFNESS, restitution=0.2, friction=0.0)
    simulation = Simulation(held_sheet() + grain, contact=contact, device=device, fps=240.0)
    simulation.step(48)
    x, v = (values[SIZE] for values in simulation.frame()[1:])
    falling = 0.2 - (0.35 - 0.33) / 1.0
    assert v[0] == pytest.approx(1.0, abs=0.1)  # less or more by the way around the edge
    assert v[2] == pytest.approx(-9.82 * falling, rel=0.15)
    assert x[2] < -0.1


def test_sides_are_in_checkpoints_and_neither_lists_nor_overflow_changes_them(device, monkeypatch):
    def run(simulation: Simulation, frames: int) -> np.ndarray:
        simulation.step(frames)
        return np.concatenate(simulation.frame()[1:])

    options = {"bumps": 0.03, "sideways": 1.0, "precision": "float32"}
    whole = thrown(20.0, device, **options)
    whole.step()
    assert held_back(whole)
    checkpoint = whole.checkpoint()
    expected = run(whole, 3)
    resumed = thrown(20.0, device, **options)
    resumed.restore(*checkpoint)
    np.testing.assert_array_equal(run(resumed, 3), expected)
    for name, value in (("LEAST_SKIN", 1.5), ("ROOM", 1)):
        monkeypatch.setattr(nearby, name, value)
        np.testing.assert_array_equal(run(thrown(20.0, device, **options), 4), expected)


def test_each_world_remembers_sides_as_if_it_were_alone(plain_device):
    rules = [Contact(thickness=THICKNESS, stiffness=STIFFNESS, restitution=1.0, friction=0.0)]
    x = np.array([[0.01, 0.02, 1.5 * THICKNESS]])
    system = held_sheet() + grains(x, np.array([[0.5, 0.0, -20.0]]))
    options = {"contact": rules, "gravity": 0.0, "device": plain_device, "fps": 240.0, "force_algorithm": "gather"}
    ensemble = Ensemble(system, 2, **options)
    alone = Simulation(system, substeps=ensemble.substeps, **options)
    for _ in range(3):
        ensemble.step()
        alone.step()
        for world in range(2):
            np.testing.assert_array_equal(ensemble.frame().position[world], alone.frame().position)
    assert alone.frame().velocity[SIZE, 2] > 19.0


def test_a_sheet_whose_triangles_are_not_turned_alike_has_no_sides():
    system = held_sheet() + grains(np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3)))
    assert system.surface is not None
    turned = system.surface.triangles.copy()
    turned[5] = turned[5, ::-1]
    for triangles, sided in ((system.surface.triangles, True), (turned, False)):
        surface = dataclasses.replace(system.surface, triangles=triangles)
        simulation = Simulation(
            system.replace(surface=surface),
            contact=Contact(stiffness=STIFFNESS, thickness=THICKNESS),
            device="cpu",
        )
        assert simulation.assembly.body_contact.surfaces.sided == sided


def test_a_grain_lies_on_a_sheet_that_hangs():
    cloth = sheet((6, 6), 0.05, mass=0.01, stiffness=300.0, damping=0.3).pin([0, 5, 30, 35])
    cloth = cloth.translate(-cloth.position.mean(axis=0))
    simulation = Simulation(
        cloth + grains(np.array([[0.03, 0.02, 0.03]]), np.zeros((1, 3))),
        contact=Contact(thickness=THICKNESS, stiffness=STIFFNESS),
        device="cpu",
        precision="float64",
    )
    # 25 grains fit where the cloth has a particle: with 32 contacts each, some ten times what springs take.
    assert simulation.substeps < 1000
    simulation.step(120)
    x = simulation.frame().position
    middle = x[:36].reshape(6, 6, 3)[2:4, 2:4, 2]
    assert middle.min() < x[-1, 2] < middle.max() + 2 * THICKNESS
