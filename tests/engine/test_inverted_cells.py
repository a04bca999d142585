"""Cells that turn inside out: no material that ships lets it happen, and it is said where it does."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import volumes

import msdwarp as msd
from msdwarp import (
    CORK,
    FOAM,
    JELLY,
    MUSCLE,
    RUBBER,
    SILICONE,
    Cells,
    Ensemble,
    InvertedWarning,
    Plane,
    Simulation,
    System,
)
from msdwarp.bodies import cells_of

SPRINGS = replace(JELLY, poissons_ratio=None)
MATERIALS = {"cork": CORK, "foam": FOAM, "jelly": JELLY, "muscle": MUSCLE, "rubber": RUBBER, "silicone": SILICONE}


def dropped(body: System, height: float, angle: float = 0.4, axis: tuple[float, ...] = (1, 0, 0)) -> Simulation:
    """Return a body that falls by a height [m] onto the ground, turned an edge or a corner ahead."""
    body = body.rotate(angle, axis=axis)
    body = body.translate((0, 0, height - body.position[:, 2].min()))
    return Simulation(body, colliders=[Plane(friction=0.6)], device="cpu")


def inverted(system: System, position: np.ndarray) -> np.ndarray:
    """Return a mask of the cells with a volume of 0 or less, by Gauss's quadrature."""
    corners = cells_of(system)
    return volumes.gradients(Cells(corners=corners, rest_volume=1.0, modulus=1.0), position)[0] <= 0


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["cube", "ball", "bar"])
@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.each_value
def test_what_falls_by_five_times_its_size_does_not_turn_inside_out(name, shape):
    size, material = 0.3, MATERIALS[name]
    h = size / 6
    body = {
        "cube": lambda: msd.box((7, 7, 7), h, material=material),
        "ball": lambda: msd.ball(size / 2, h, material=material),
        "bar": lambda: msd.box((13, 7, 7), h, material=material),
    }[shape]()
    simulation = dropped(body, 5 * size)
    for _ in range(70):  # it lands after 0.55 s
        simulation.step()
        assert simulation.measure().inverted == 0


@pytest.mark.slow
@pytest.mark.parametrize(("material", "size"), [(JELLY, 0.2), (JELLY, 1.0), (RUBBER, 1.0)], ids=str)
def test_large_bodies_stand_up_again(material, size):
    # Jelly of a metre lands at 2.8 times its speed of sound: a cell may be inside out while it is crushed.
    bar = (25, 9, 9) if material is RUBBER else (9, 9, 9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InvertedWarning)
        simulation = dropped(msd.box(bar, size / 8, material=material), 5 * size, 0.9, (1, 1, 0.3))
        simulation.step(round(60 * (2 * 10 * size / 9.82) ** 0.5) + 60)
    assert simulation.measure().inverted == 0
    # Jelly of a metre is lower by its own weight: ρ g L/E = 0.8.
    assert np.ptp(simulation.frame().position[:, 2]) > 0.6 * size


def test_a_crushed_body_of_springs_alone_is_said_to_be_inside_out_once():
    simulation = dropped(msd.box((6, 6, 6), 0.04, material=SPRINGS).named("pudding"), 0.5)
    said = r"^up to 0\.\d+ s \d+ of 125 cells of 'pudding' are turned inside out; .*poissons_ratio=0\.45"
    with pytest.warns(InvertedWarning, match=said) as caught:
        simulation.step(100)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    system, position = simulation.system, simulation.frame().position
    assert simulation.measure().inverted == np.count_nonzero(inverted(system, position)) > 20
    assert simulation.measure().largest_strain < 0.3  # most of its springs are content


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.each_value
def test_the_count_is_that_of_signed_volumes(plain_device, dim, precision):
    random = np.random.default_rng(3)
    one = msd.sheet((7, 5), 0.1, dim=2) if dim == 2 else msd.box((6, 5, 4), 0.1)
    system = one + one.translate((2.0,) * dim)
    if dim == 3:
        system += msd.sheet((4, 4), 0.1).translate((0, 0, 3))  # sheets in space have no inside
    system = system.replace(position=(system.position + 0.05 * random.normal(size=system.position.shape)))
    simulation = Simulation(system, gravity=0.0, device=plain_device, precision=precision)
    found = simulation.assembly.inverted_cells.find(simulation.state.x)[0]
    np.testing.assert_array_equal(found, inverted(system, simulation.frame().position))
    assert 0 < np.count_nonzero(found) == simulation.measure().inverted < len(found) / 2


@pytest.mark.parametrize("dim", [2, 3])
def test_a_mirrored_body_is_not_inside_out(dim):
    one = msd.sheet((4, 3), 0.1, dim=2) if dim == 2 else msd.box((4, 3, 3), 0.1)
    mirrored = one.replace(position=one.position * [-1.0, *[1.0] * (dim - 1)]).translate((1.0,) * dim)
    simulation = Simulation(one + mirrored, gravity=0.0, device="cpu")
    assert simulation.measure().inverted == 0
    folded = mirrored.position[:, 0] < np.median(mirrored.position[:, 0]) - 0.01
    x = mirrored.position.copy()
    x[folded, 0] = 2 * np.median(x[:, 0]) - x[folded, 0]
    assert Simulation(mirrored.replace(position=x), gravity=0.0, device="cpu").measure().inverted > 0


def test_a_body_that_is_all_inside_out_is_so_after_a_change(plain_device):
    simulation = Simulation(msd.box((3, 3, 3), 0.1), gravity=0.0, device=plain_device)
    simulation.step()
    x = simulation.frame().position * (1.0, 1.0, -1.0)
    for _ in range(2):
        simulation.state.x.assign(x)
        assert simulation.measure().inverted == 8
        simulation.change(stiffness=90.0)
    assert simulation.measure().inverted == 8


def test_torn_cells_do_not_count():
    body = msd.box((4, 4, 4), 0.1)
    x = body.position.copy()
    x[21] += 0.35
    pulled = (body.connections == 21).any(axis=1)
    counts = []
    for broken in (np.zeros_like(pulled), pulled, ~pulled):
        torn = body.replace(broken_at=np.where(broken, 0.0, np.inf)).replace(position=x)
        counts.append(Simulation(torn, gravity=0.0, device="cpu").measure().inverted)
    # A cell of particle 21 has springs of both kinds.
    assert counts[0] > 0
    assert counts[1:] == [0, 0]


def test_worlds_of_an_ensemble_are_counted_each_for_itself():
    body = msd.box((4, 4, 4), 0.1)
    x = np.repeat(body.position[None], 3, axis=0)
    x[1, 21] += 0.35
    x[2, :] *= (1.0, 1.0, -1.0)
    found = Ensemble(body, 3, position=x, gravity=0.0, device="cpu").inverted
    assert found.tolist() == [0, np.count_nonzero(inverted(body, x[1])), 27]
