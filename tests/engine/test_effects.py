"""The seam by which effects come into a scene: one that this file makes up is stepped, bounded and measured."""

import functools
import math

import numpy as np
import pytest
import warp as wp
from problems import EPS64

from msdwarp import RK4, Leapfrog, LinearlyImplicitEuler, Simulation, System, box, chain
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.model.effect import Effect
from msdwarp.engine.model.model import Model
from msdwarp.engine.stepping import assemble as effects
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.engine.stepping.dynamics import Dynamics
from msdwarp.kernels.basis import vector
from msdwarp.kernels.effect import ForceTerm, instant
from msdwarp.world import Problem

K = 36.0
"""Stiffness of the anchors [N/m]."""


@functools.cache
def anchored(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the device side of anchors: a spring from every particle to a place of its own."""
    V, Instant = vector(dim, scalar), instant(dim, scalar, compensated)

    @wp.struct
    class Anchors:
        stiffness: scalar
        place: wp.array(dtype=V)

    @wp.func
    def pull(data: Anchors, now: Instant, i: int) -> V:
        return data.stiffness * (data.place[i] - now.x[i])

    return ForceTerm("anchors", Anchors, force=pull)


class Anchors(Effect):
    """Holds every particle at the origin, by a spring."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self.term = anchored(model.dim, model.scalar, model.compensated)
        self.data = self.term.Data()
        self.data.stiffness = K
        self.data.place = wp.zeros(model.particle_count, dtype=model.vector, device=model.device)
        self.told: list = []

    def begin(self, substeps: int, dt: float) -> None:
        self.told.append(("begin", substeps, dt))

    def begin_frame(self, time: float) -> None:
        self.told.append(("frame", time))

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        blocks = stiffness.numpy() + K * np.eye(self._model.dim)
        stiffness.assign(blocks)

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[np.ndarray, np.ndarray]:
        return 0.5 * K * (x.numpy().astype(float) ** 2).sum(keepdims=True).ravel(), np.zeros(1)


@pytest.fixture
def with_anchors(monkeypatch):
    """Have every scene anchored."""
    monkeypatch.setattr(effects, "EFFECTS", [*effects.EFFECTS, lambda model, *_: Anchors(model)])


def start(dim: int) -> System:
    """Return particles of two masses, apart from where they are held, at rest."""
    position = np.arange(1.0, 1.0 + 3 * dim).reshape(3, dim)
    return System(position=position, mass=[1.0, 4.0, 1.0], connections=[(0, 1)], stiffness=0.0)


@pytest.mark.parametrize("blocks", ["auto", None], ids=["one launch", "launches"])
@pytest.mark.parametrize("method", [RK4(), Leapfrog()], ids=str)
@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.each_value
def test_its_force_acts(with_anchors, device, dim, method, blocks):
    # Every coordinate swings as x cos(ωt) with ω² = k/m: 6 and 3 rad/s. RK4 at hω = 0.01 errs by (hω)⁴ ωt / 120 of
    # the amplitude of 9 m, leapfrog by (hω)² ωt / 24; its velocities, means over two substeps, by (hω)²/8 more.
    options = {"gravity": 0.0, "precision": "float64", "fps": 10.0, "substeps": 60, "blocks": blocks}
    simulation = Simulation(start(dim), integrator=method, device=device, **options)
    simulation.step(10)
    omega = np.sqrt(K / simulation.system.mass)[:, None]
    error, mean = (9 * 6 * 0.01**4 / 120, 0.0) if method == RK4() else (9 * 6 * 0.01**2 / 24, 9 * 0.01**2 / 8)
    frame = simulation.frame()
    np.testing.assert_allclose(frame.position, start(dim).position * np.cos(omega), rtol=0, atol=error + 1e-12)
    np.testing.assert_allclose(
        frame.velocity, -omega * start(dim).position * np.sin(omega), rtol=0, atol=6 * (error + mean) + 1e-11
    )


@pytest.mark.slow
def test_columns_of_a_lattice_feel_it(with_anchors, in_columns, plain_device):
    body = box((4, 4, 4), 0.1, mass=0.01, stiffness=20.0)
    options = {"gravity": 0.0, "precision": "float64", "fps": 1000.0, "substeps": 2, "device": plain_device}
    frames = []
    for force_algorithm in ("stencil", "scatter"):
        simulation = Simulation(body, force_algorithm=force_algorithm, blocks=None, **options)
        simulation.step(20)
        frames.append(simulation.frame().position)
    # Sums in another order: 40 substeps of a few roundings of forces, which are small beside the positions.
    np.testing.assert_allclose(frames[0], frames[1], rtol=0, atol=40 * 4 * EPS64)
    assert np.abs(frames[0] - body.position).max() > 0.01


@pytest.mark.slow
def test_an_implicit_method_feels_it(with_anchors, plain_device):
    # Explicitly, as every force but springs: first order, (hω)/2 · ωt of 9 m.
    # There are no springs: the solver is there at once. Short frames, as each launch of a frame is recorded.
    options = {"gravity": 0.0, "precision": "float64", "fps": 1000.0, "substeps": 6, "device": plain_device}
    simulation = Simulation(start(1), integrator=LinearlyImplicitEuler(iterations=2), **options)
    simulation.step(1000)
    expected = start(1).position * np.cos(np.sqrt(K / simulation.system.mass))[:, None]
    np.testing.assert_allclose(simulation.frame().position, expected, rtol=0, atol=9 * 6 * 6 / 6000)


@pytest.mark.slow
def test_an_implicit_method_has_no_longer_steps_than_it_bears(with_anchors, plain_device):
    # Springs may be as stiff as they like; anchors pull explicitly: h ≤ 2/ω, the bound of ω² may be twice it.
    method = LinearlyImplicitEuler(iterations=2)
    how = {"gravity": 0.0, "fps": 0.5, "precision": "float64", "device": plain_device}
    simulation = Simulation(start(1), integrator=method, **how)
    assert simulation.substeps >= math.ceil(2.0 * 6 / 2 / 0.8)
    before = simulation.measure().energy
    simulation.step(8)  # some hundred substeps
    assert simulation.measure().energy < 10 * before


def test_energy_counts_what_it_stores(with_anchors, device):
    simulation = Simulation(
        start(2), integrator=RK4(), gravity=0.0, device=device, precision="float64", substeps=20
    )
    before = simulation.measure()
    assert before.effect_energy == pytest.approx(0.5 * K * (start(2).position ** 2).sum(), rel=4 * EPS64)
    simulation.step(30)
    after = simulation.measure()
    assert after.kinetic_energy > 0.05 * after.energy
    # RK4 loses (hω)⁶/72 of the energy in each of 600 substeps: hω = 6/1200.
    assert after.energy == pytest.approx(before.energy, rel=600 * 0.005**6 / 72 + 600 * 4 * EPS64)


def test_the_step_bears_it(with_anchors, device):
    # k/m of the light particles is 36 s⁻²; the bound may be twice that.
    model = assemble(Problem(system=start(3)), device=device, precision="float64")
    assert K <= rate_bounds(start(3), model).stiffness <= 2 * K * (1 + 4 * EPS64)


def test_it_is_told_what_begins(with_anchors):
    simulation = Simulation(start(1), device="cpu", substeps=3, fps=50.0)
    simulation.step(2)
    told = simulation.assembly.all[-1].told
    assert told == [("begin", 3, pytest.approx(1 / 150)), ("frame", 0.0), ("frame", pytest.approx(0.02))]


def test_gradients_refuse_it_by_name(with_anchors):
    simulation = Simulation(chain(3, mass=1.0, stiffness=1.0), integrator=Leapfrog(), device="cpu")
    with pytest.raises(ValueError, match="Anchors"):
        simulation.gradient(lambda frames: 0.0, 1)


def test_a_scene_without_it_has_nothing_of_it():
    plain = Dynamics(assemble(Problem(system=chain(3)), device="cpu"))
    assert plain.composition.terms == ()
    assert "anchors" not in {name for name, *_ in plain.scene._cls.vars.items()}
    assert math.isfinite(rate_bounds(chain(3)).stiffness)
