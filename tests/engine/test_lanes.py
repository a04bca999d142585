"""Threads that share a particle of a small body: the algorithms with several lanes, which a GPU has."""

import numpy as np
import pytest
from tangles import tangle

from msdwarp import RK4, Leapfrog, Plane, Simulation, SymplecticEuler, System, Wind, box, sheet
from msdwarp.engine.springs import force_algorithms as forces
from msdwarp.kernels.springs.gather import gather

FALLING = {"colliders": [Plane(offset=-3.0)], "gravity": 9.82}
BODIES = {
    "solid": box((5, 4, 3), damping=2.0).rotate(0.3, (1, 2, 3)).translate((0, 0, 2)),
    "cloth": sheet((6, 5), damping=1.0).rotate(0.4, (1, 1, 0)).translate((0, 0, 3)),
    "bent": sheet((7, 6), damping=1.0, bending=2.0).translate((0, 0, 2)),
}


def moved(system: System, frames: int = 10, force_algorithm: str = "stencil", **options) -> np.ndarray:
    simulation = Simulation(system, force_algorithm=force_algorithm, **(FALLING | options))
    simulation.step(frames)
    return simulation.frame().position


@pytest.fixture
def one_lane(monkeypatch) -> None:
    """Have what lanes take be taken by one, as a CPU can."""

    def begin(self, model, fracture, lanes):
        lattice, laws = model.lattice, model.laws
        laws = laws if lattice.constants["damping"].any() else laws._replace(damper=None)
        self.force_algorithm = forces.stencil_of_lanes(
            model.dim, model.scalar, laws, model.compensated, lattice.steps, 1, lattice.rimmed
        )
        self._share(model, lattice)

    monkeypatch.setattr(forces.Stencil, "__init__", begin)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "precision"),
    [
        ("cloth", "float64"),
        pytest.param("solid", "float32-compensated", marks=pytest.mark.slow),
        pytest.param("bent", "float64", marks=pytest.mark.slow),
    ],
)
def test_one_lane_adds_up_as_the_stencil_does(name, precision, request):
    options = {"device": "cpu", "precision": precision}
    by_stencil = moved(BODIES[name], **options)
    request.getfixturevalue("one_lane")
    assert np.array_equal(moved(BODIES[name], **options), by_stencil)  # the same neighbours in the same order


@pytest.mark.slow
@pytest.mark.parametrize("own", [("rest_length",), ("stiffness",)], ids=["kinds", "own"])
def test_one_lane_adds_up_as_gathering_does(own, monkeypatch):
    # A tangle: slices of the table have slots that pad.
    body = tangle(3, 200 if own == ("stiffness",) else 65, own, damped=True)
    options = {"device": "cpu", "force_algorithm": "gather", "precision": "float64", "colliders": []}
    by_table = moved(body, **options)
    monkeypatch.setattr(forces, "gather", lambda *kinds: gather(*kinds[:-1], 1))
    assert np.array_equal(moved(body, **options), by_table)


@pytest.mark.gpu
@pytest.mark.parametrize("lanes", [2, 4, 8])
@pytest.mark.parametrize("blocks", [None, (1, 64), (8, 32)], ids=["stages", "block", "cluster"])
@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog(damper_extrapolation=0.5), RK4()], ids=repr)
def test_lanes_change_nothing_but_the_order_of_sums(lanes, blocks, integrator, monkeypatch):
    # In free flight, so that no contact decides by rounding; 10 frames of float64 leave 1e-12 of the 2 m at most.
    for name, force_algorithm in [
        ("solid", "stencil"),
        ("cloth", "stencil"),
        ("bent", "stencil"),
        ("solid", "gather"),
    ]:
        found = []
        for count in (1, lanes):
            monkeypatch.setattr(forces, "lanes", lambda model, tears, count=count: count)
            options = {"integrator": integrator, "blocks": blocks, "device": "cuda:0", "precision": "float64"}
            found.append(moved(BODIES[name], force_algorithm=force_algorithm, colliders=[], **options))
        assert np.abs(found[0] - found[1]).max() < 1e-12


@pytest.mark.gpu
def test_loads_obstacles_and_work_are_counted_once_for_all_lanes(monkeypatch):
    found = []
    for count in (1, 4):
        monkeypatch.setattr(forces, "lanes", lambda model, tears, count=count: count)
        simulation = Simulation(
            BODIES["cloth"],
            force_algorithm="stencil",
            loads=[Wind((2.0, 0.0, 1.0))],
            device="cuda:0",
            precision="float64",
            contact_forces=True,
            **FALLING,
        )
        simulation.step(48)  # 3 m down, onto the plane
        measures = simulation.measure()
        found.append((measures.energy, measures.external_work, simulation.contact_force().sum(axis=0)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)  # contact multiplies what rounding differs in


@pytest.mark.gpu
@pytest.mark.parametrize(
    "shape", [(3, 3, 3), (4, 4, 4), (6, 6, 6), (8, 8, 8), (12, 12, 12), (20, 20, 20), (26, 40, 32)]
)
def test_bodies_of_every_size_have_lanes_that_agree_with_scattering(shape):
    body = box(shape, damping=2.0).spin((0.1, 0.2, 0.3))
    routes = ("scatter", "stencil", "gather")
    frames = [
        Simulation(body, force_algorithm=force_algorithm, device="cuda:0", precision="float64")
        for force_algorithm in routes
    ]
    for one in frames:
        one.step(5)
    a, *others = (one.frame().position for one in frames)
    for b in others:
        assert np.abs(a - b).max() < 1e-12 * np.abs(a).max()
