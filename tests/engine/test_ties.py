"""ExtraSprings: connections between lattices, beside their stencil, are connections like all others."""

import numpy as np
import pytest
from problems import EPS64
from tangles import FAR, assert_forces_are_right, evaluate, moving

from msdwarp import CoulombDamper, Simulation, System, box, chain, join, sheet
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.model.model import Model
from msdwarp.engine.stepping import per_stage
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.engine.stepping.dynamics import Dynamics
from msdwarp.world import Problem

SMALL = {"mass": 0.01, "stiffness": 40.0, "damping": 0.02}
GAP = 0.13
"""Between two bodies that are joined [m]."""


def pair(dim: int = 3, **constants) -> System:
    """Return two lattices that lie side by side, tied along a face by stiffer springs that are damped."""
    made = {3: lambda: box((3, 3, 4), 0.1, **SMALL), 2: lambda: sheet((3, 5), 0.1, dim=2, **SMALL)}
    one = made[dim]() if dim > 1 else chain(5, 0.1, dim=1, **SMALL)
    width = float(np.ptp(one.position[:, 0])) + GAP
    other = one.translate([width, *[0.0] * (dim - 1)])
    return join(one, other, within=GAP, **{"stiffness": 70.0, "damping": 0.03, **constants})


def options(device: str, **more) -> dict:
    return {"gravity": 0.0, "precision": "float64", "fps": 60.0, "substeps": 8, "device": device, **more}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dim", "precision"), [(1, "float64"), (2, "float64"), (3, "float64"), (3, "float32-compensated")]
)
def test_a_stencil_has_the_forces_of_its_ties(plain_device, dim, precision):
    tied = moving(pair(dim))
    assert len(Model(tied, device="cpu", force_algorithm="stencil").lattice.ties) > 0
    tied = tied if precision == "float64" else tied.translate(FAR)
    assert_forces_are_right(tied, plain_device, precision, "stencil")


@pytest.mark.slow
def test_ties_obey_the_dampers_law(plain_device):
    # As by gathering, which test_dampers compares with the law; each sum of 20 or so has its own roundings.
    dry = moving(pair()).replace(damper=CoulombDamper(0.5))
    forces = [evaluate(dry, plain_device, "float64", force_algorithm) for force_algorithm in ("gather", "stencil")]
    np.testing.assert_allclose(*forces, rtol=0, atol=64 * EPS64 * np.abs(forces[0]).max())


@pytest.mark.slow
def test_columns_feel_ties(plain_device, in_columns):
    tied = pair()
    made = Dynamics(assemble(Problem(system=tied), device="cpu", force_algorithm="stencil"))
    assert (
        per_stage.column_count(made.model, made.composition.force_algorithm) > 0
    )  # one stencil for both bodies, as without ties
    assert_forces_are_right(moving(tied), plain_device, "float64", "stencil")


def test_where_only_ties_are_damped_the_stencil_is_not():
    tied = pair().replace(
        damping=np.where(np.arange(pair().connection_count) < pair().connection_count - 12, 0.0, 1.0)
    )
    own = Dynamics(
        assemble(Problem(system=tied), device="cpu", force_algorithm="stencil")
    ).composition.force_algorithm
    bare = Dynamics(
        assemble(Problem(system=tied.replace(damping=0.0)), device="cpu", force_algorithm="stencil")
    ).composition.force_algorithm
    assert own is bare


def test_energies_count_a_tie_once(device):
    tied = moving(pair())
    simulation = Simulation(tied, **options(device, substeps=1, allow_unstable=True))
    length = np.linalg.norm(np.subtract(*np.moveaxis(tied.position[tied.connections], 1, 0)), axis=1)
    elastic = (0.5 * tied.stiffness * (length - tied.rest_length) ** 2).sum()
    found = simulation.measure()
    assert found.elastic_energy == pytest.approx(elastic, rel=64 * EPS64)
    assert found.effect_energy == 0.0


def test_the_bound_knows_stiff_ties(plain_device):
    # One algorithm or the other, the same pass over all connections; a stiff tie halves the step and more.
    soft, stiff = pair(), pair(stiffness=4e4)
    bounds = [
        rate_bounds(
            stiff,
            assemble(
                Problem(system=stiff), device=plain_device, precision="float64", force_algorithm=force_algorithm
            ),
        ).stiffness
        for force_algorithm in ("gather", "stencil")
    ]
    assert bounds[0] == pytest.approx(bounds[1], rel=64 * EPS64)  # atomic sums have no order on a GPU
    assert bounds[0] > 4 * rate_bounds(soft).stiffness
    # Two particles of mass m on a spring of k swing with ω² = 2 k / m, and others hold them stiffer still.
    assert bounds[0] >= 2 * 4e4 / 0.01


@pytest.mark.slow
def test_a_stable_step_bears_a_tie_much_stiffer_than_the_bodies(plain_device):
    tied = moving(pair(stiffness=4e4, damping=0.0), 5).replace(position=pair().position)
    simulation = Simulation(tied, force_algorithm="stencil", gravity=0.0, device=plain_device, precision="float64")
    before = simulation.measure().energy
    simulation.step(30)
    assert simulation.measure().energy < 1.5 * before  # its energy swings by h ω / 2 about the conserved one
    with pytest.raises(ValueError, match="at least"):
        Simulation(
            tied, force_algorithm="stencil", gravity=0.0, device=plain_device, substeps=simulation.substeps // 3
        )
