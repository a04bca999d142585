"""One and two dimensions: what they save, and that they are the flat cases of three."""

import math

import numpy as np
import pytest
from problems import EPS64

from msdwarp import Box, Capsule, Cone, CoulombDamper, Plane, Simulation, Sphere, System, chain, sheet
from msdwarp.engine.device.vector_arrays import ALIGNED
from msdwarp.engine.model.model import Model
from msdwarp.engine.model.state import State

AXES = {1: [0], 2: [0, 2]}
"""Which axes of space the coordinates of a plane system are: the last one points up."""


def embedded(system: System) -> System:
    """Return a system of one or two coordinates in space."""
    position, velocity = np.zeros((2, system.particle_count, 3))
    position[:, AXES[system.dim]], velocity[:, AXES[system.dim]] = system.position, system.velocity
    fields = {name: getattr(system, name) for name in vars(system)}
    return System(**fields | {"position": position, "velocity": velocity, "surface": None})


def compare(
    flat: System, device: str, *, frames: int, atol: float, colliders=((), ()), gravity=(9.82, 9.82), **options
):
    """Run a system and the same in space, and check that the second stays flat and moves as the first does."""
    found = []
    for system, around, g in zip((flat, embedded(flat)), colliders, gravity, strict=True):
        simulation = Simulation(system, colliders=around, gravity=g, device=device, **options)
        simulation.step(frames)
        found.append(simulation.snapshot())
    one, space = found
    across = [k for k in range(3) if k not in AXES[flat.dim]]
    assert not space.position[:, across].any()
    assert not space.velocity[:, across].any()
    np.testing.assert_allclose(space.position[:, AXES[flat.dim]], one.position, rtol=0, atol=atol)
    return one, space


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_fewer_coordinates_take_less_memory(device, precision):
    # Records of three coordinates are four numbers; one is one number, and two are two.
    size = 8 if precision == "float64" else 4
    count = 1000
    for dim, numbers in ((1, 1), (2, 2), (3, 4)):
        model = Model(chain(count, dim=dim), device=device, precision=precision)
        state = State.from_system(model.system, model)
        assert state.x.strides == state.v.strides == (numbers * size,)
        # All of what is held, in one piece, but for the margin that a stencil may read beyond both ends, and for
        # what is left of a cache's line.
        assert state.x._ref is state.v._ref
        needed = 2 * (count + 2 * model.margin) * numbers * size
        assert needed <= state.x._ref.capacity < needed + 2 * ALIGNED * size
        assert model.margin < 0.1 * count


def test_a_row_is_as_one_in_space(device):
    row = chain(12, spacing=0.5, mass=0.2, stiffness=300.0, damping=0.4, dim=1).pin(0)
    row = row.with_velocity(np.random.default_rng(7).uniform(-0.5, 0.5, (12, 1)))
    row = row.replace(yield_strain=0.02, relaxation_time=0.05)
    # 400 substeps with roundings of 6 m, which the springs' forces pass on: ω h of them a substep, below 1.
    how = {"gravity": ((3.0,), (3.0, 0, 0)), "substeps": 20, "precision": "float64"}
    one, space = compare(row, device, frames=20, atol=400 * 6 * EPS64, **how)
    np.testing.assert_allclose(space.rest_length, one.rest_length, rtol=0, atol=400 * 6 * EPS64)
    assert np.abs(one.rest_length - row.rest_length).max() > 0.005
    assert np.abs(one.position - row.position).max() > 0.1


@pytest.mark.slow
def test_a_row_between_walls_is_as_one_in_space(device):
    row = chain(6, spacing=0.5, mass=0.2, stiffness=300.0, damping=0.4, dim=1).with_velocity((3.0,))
    walls = (
        [Plane((1.0,), offset=-1.5), Box((2.5,), (1.0,)), Sphere((-3.0,), 0.5)],
        [Plane((1, 0, 0), offset=-1.5), Box((2.5, 0, 0), (1, 9, 9)), Sphere((-3.0, 0, 0), 0.5)],
    )
    how = {"colliders": walls, "gravity": (0.0, 0.0), "substeps": 40, "precision": "float64"}
    one, _ = compare(row, device, frames=60, atol=2400 * 3 * EPS64, **how)
    assert one.position.max() < 2.0
    assert one.position.min() > -1.5 - 1e-12  # roundings


def hits(dim: int) -> list:
    """Return obstacles that look the same in the plane and, across it, in space."""

    def at(x: float, z: float) -> tuple[float, ...]:
        return (x, z) if dim == 2 else (x, 0.0, z)

    def turned(angle: float):  # from x towards z
        return angle if dim == 2 else (0.0, -angle, 0.0)

    def sway(t: float):
        return at(0.3 * t, 0.1 * math.sin(5 * t)), turned(0.4 * t)

    return [
        Plane(at(0.1, 1.0), friction=0.4),
        Sphere(at(0.1, 0.0), 0.25, friction=0.2),
        Box(at(1.0, 0.1), (0.4, 0.5) if dim == 2 else (0.4, 2.0, 0.5), turned(0.3), friction=0.6, motion=sway),
        Capsule(at(-0.8, 0.3), at(-0.4, 0.1), 0.1),
        Cone(at(-1.2, 0.6), at(-1.3, -0.2), 0.3),
    ]


@pytest.mark.slow
def test_a_block_in_the_plane_is_as_one_in_space(device):
    # It falls askew among obstacles of every kind, one of which moves and turns.
    block = sheet((9, 4), 0.25, mass=0.05, stiffness=200.0, damping=0.2, dim=2).rotate(0.2).translate((0.0, 1.2))
    block = block.replace(damper=CoulombDamper(0.1))
    # 4000 substeps with roundings of 1 m; where particles are caught or slide is sensitive to a hundredfold.
    how = {"colliders": (hits(2), hits(3)), "substeps": 100, "precision": "float64"}
    one, _ = compare(block, device, frames=40, atol=100 * 4000 * EPS64, **how)
    assert np.abs(one.strain).max() > 0.02  # it has been hit


def test_measures_do_not_depend_on_the_dimension(device):
    row = chain(5, spacing=0.5, mass=0.2, stiffness=300.0, damping=0.4, dim=1).with_velocity((0.7,))
    row = row.replace(position=1.1 * row.position)
    found = []
    for system, gravity in ((row, (-9.0,)), (embedded(row), (-9.0, 0, 0))):
        simulation = Simulation(system, gravity=gravity, device=device, precision="float64")
        found.append(simulation.measure())
    for name in ("kinetic_energy", "elastic_energy", "gravitational_energy", "dissipated_power", "largest_strain"):
        assert getattr(found[0], name) == pytest.approx(getattr(found[1], name), rel=8 * EPS64, abs=8 * EPS64)
    assert found[0].momentum[0] == pytest.approx(found[1].momentum[0], rel=4 * EPS64)
    assert [len(one.angular_momentum) for one in found] == [0, 3]
