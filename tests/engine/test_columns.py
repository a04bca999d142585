"""Columns, in which a stencil takes two layers at once: the same forces and the same motion."""

import numpy as np
import pytest
from tangles import FAR, assert_forces_are_right, lattices, moving

from msdwarp import box, sheet
from msdwarp.engine.model.lattice import find_lattice
from msdwarp.engine.model.model import Model
from msdwarp.engine.stepping import per_stage

# Algorithms are compared from wherever bodies start, in the floor too.
pytestmark = pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")


LAYERED = (
    "sheet 4",
    "sheet 8",
    "smallest sheet",
    "box 6",
    "box 26",
    "smallest box",
    "thin box",
    "two equal boxes",
)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 2.0])
@pytest.mark.parametrize("name", LAYERED)
@pytest.mark.each_value
def test_forces_in_columns(plain_device, in_columns, name, damping):
    system = moving(lattices(damping)[name])
    stride = find_lattice(system).stride
    assert per_stage.columns(Model(system, device="cpu", force_algorithm="stencil")) in range(
        system.particle_count // 2, system.particle_count // 2 + stride + 1
    )
    assert_forces_are_right(system, plain_device, "float64", "stencil")


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(3, 4, 2), (3, 4, 3), (4, 3, 6), (2, 2, 9)])
@pytest.mark.parametrize("precision", [pytest.param("float32", marks=pytest.mark.slow), "float32-compensated"])
@pytest.mark.each_value
def test_forces_in_columns_in_single_precision(plain_device, in_columns, precision, shape):
    far = moving(box(shape, stiffness=30.0, damping=2.0)).translate(FAR)
    assert_forces_are_right(far, plain_device, precision, "stencil")


@pytest.mark.parametrize("columns", [False, True])
def test_directions_may_be_named_in_any_order(plain_device, request, columns):
    if columns:
        request.getfixturevalue("in_columns")
    grid = moving(sheet((5, 4), stiffness=30.0, damping=2.0))
    stiffness = np.empty(grid.connection_count)
    for k, part in enumerate(grid.directions[0].values()):
        stiffness[part] = 10.0 * (k + 1)
    names = list(grid.directions[0])
    for order in (names, names[::-1]):
        named = grid.replace(stiffness=stiffness, directions=({n: grid.directions[0][n] for n in order},))
        assert_forces_are_right(named, plain_device, "float64", "stencil")
