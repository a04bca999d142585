"""Loads that are sums over elements need one function of the device; this file makes up such a load."""

import functools
import math
import sys
from dataclasses import dataclass

import numpy as np
import pytest
import warp as wp
from load_checks import check_load
from problems import EPS64

from msdwarp import RK4, Simulation, System
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.world import ElementLoad, Problem

K, C = 36.0, 4.0
"""Stiffness of the bonds [N/m], and of the anchors over the mass that they hold [1/s²]."""


@functools.cache
def evaluate(dim: int, scalar: type):
    """Compose the force of a bond of no length between two particles, and its energy."""
    Own, Rows = wp.types.vector(1, scalar), wp.types.matrix((2, dim), scalar)

    @wp.func
    def pull(own: Own, x: Rows, v: Rows):
        apart = x[1] - x[0]
        forces = Rows()
        forces[0] = own[0] * apart
        forces[1] = -own[0] * apart
        return forces, scalar(0.5) * own[0] * wp.dot(apart, apart)

    return pull


@dataclass(frozen=True, eq=False, repr=False)
class Bonds(ElementLoad):
    """Bonds between successive particles."""

    def elements(self, system):
        first = np.arange(system.particle_count - 1)
        return np.stack([first, first + 1], axis=1), np.full((len(first), 1), K)


@functools.cache
def hold(dim: int, scalar: type):
    """Compose the force that pulls a particle to the origin, and its energy."""
    Own, Rows = wp.types.vector(1, scalar), wp.types.matrix((1, dim), scalar)

    @wp.func
    def pull_back(own: Own, x: Rows, v: Rows):
        return -own[0] * x, scalar(0.5) * own[0] * wp.dot(x[0], x[0])

    return pull_back


@dataclass(frozen=True, eq=False, repr=False)
class Anchors(ElementLoad):
    """Anchors of all particles, a second law in this file."""

    law = "hold"

    def elements(self, system):
        return np.arange(system.particle_count)[:, None], C * system.mass[:, None]


@pytest.fixture(autouse=True)
def in_kernels(monkeypatch):
    """Have this file stand for one in `kernels/loads`."""
    monkeypatch.setitem(sys.modules, f"msdwarp.kernels.loads.{__name__}", sys.modules[__name__])


def two(dim: int) -> System:
    """Return two particles that are bound, one of four times the mass of the other."""
    return System(position=[[0.0] * dim, [3.0] + [1.0] * (dim - 1)], mass=[1.0, 4.0])


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_two_particles_swing_about_their_centre(dim, plain_device):
    # ω² = k (1/m + 1/M) + c = 49 s⁻²; RK4 errs by (hω)⁴ ωt / 120 of the amplitude: hω = 7/600. Their centre swings
    # with ω² = c, since each anchor is as stiff as its particle is heavy.
    options = {"gravity": 0.0, "precision": "float64", "fps": 10.0, "substeps": 60, "device": plain_device}
    simulation = Simulation(two(dim), loads=[Bonds(), Anchors()], integrator=RK4(), **options)
    simulation.step(10)
    apart = np.diff(simulation.frame().position, axis=0)[0]
    start = np.diff(two(dim).position, axis=0)[0]
    np.testing.assert_allclose(apart, start * math.cos(7.0), rtol=0, atol=3 * 0.0117**4 * 7 / 120)
    moment = two(dim).mass @ two(dim).position
    swung = two(dim).mass @ simulation.frame().position
    np.testing.assert_allclose(swung, moment * math.cos(2.0), rtol=0, atol=12 * (2 / 600) ** 4 * 2 / 120)


def test_the_bound_of_the_step_follows_from_its_derivatives(plain_device):
    # The light particle has 2 K/m in the bound; the pair swings with 45 s⁻².
    assembly = assemble(Problem(system=two(3), loads=[Bonds()]), device=plain_device, precision="float64")
    assert rate_bounds(two(3), assembly).stiffness == pytest.approx(2 * K, rel=4 * EPS64)


def test_it_has_all_that_a_load_has(plain_device):
    draw = np.random.default_rng(0).normal
    check_load(Bonds(), System(position=draw(size=(5, 3)), velocity=draw(size=(5, 3)), mass=0.3), plain_device)
