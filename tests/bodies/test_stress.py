"""Stress of bodies with cells: that of elasticity where strain is homogeneous."""

import re

import numpy as np
import pytest

from msdwarp import Material, TensionOnlySpring, ball, box, sheet, stress, von_mises

E, SMALL = 1e5, 1e-6


def stuff(ratio: float) -> Material:
    return Material(density=1000.0, youngs_modulus=E, poissons_ratio=ratio)


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.35, 0.49])
@pytest.mark.parametrize("shape", ["box", "ball"])
def test_a_pulled_body_has_the_stress_of_the_pull(shape, ratio):
    make = {
        "box": lambda: box((5, 4, 4), 0.1, material=stuff(ratio)),
        "ball": lambda: ball(0.3, 0.1, material=stuff(ratio)),
    }
    system = make[shape]()
    found = stress(system, system.position * (1 + SMALL, 1 - ratio * SMALL, 1 - ratio * SMALL))
    expected = np.zeros((3, 3))
    expected[0, 0] = E * SMALL
    # Terms of second order in the strain, times λ/E (16 at 0.49).
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-4 * E * SMALL)
    np.testing.assert_allclose(von_mises(found), E * SMALL, rtol=2e-4)


@pytest.mark.parametrize("ratio", [0.1, 0.45])
def test_shear_and_pressure(ratio):
    system = box((4, 4, 4), 0.1, material=stuff(ratio))
    x = np.array(system.position)
    x[:, 0] += SMALL * x[:, 2]
    found = stress(system, x)
    shear = E / (2 * (1 + ratio)) * SMALL
    np.testing.assert_allclose(found[:, 0, 2], shear, rtol=1e-4)
    np.testing.assert_allclose(von_mises(found), np.sqrt(3) * shear, rtol=1e-4)
    blown = stress(system, system.position * (1 + SMALL))
    bulk = E / (3 * (1 - 2 * ratio))
    np.testing.assert_allclose(np.trace(blown, axis1=1, axis2=2) / 3, 3 * bulk * SMALL, rtol=1e-4)
    np.testing.assert_allclose(von_mises(blown), 0.0, atol=1e-4 * bulk * SMALL)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_sheet_has_stress_in_its_plane(dim):
    system = sheet((5, 4), 0.1, material=stuff(0.45), thickness=0.02, dim=dim)
    scale = np.array([1 + SMALL, 1 - 0.45 * SMALL, 1.0])[:dim]
    found = stress(system, system.position * scale)
    expected = np.zeros((dim, dim))
    expected[0, 0] = E * 0.02 * SMALL
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-4 * E * 0.02 * SMALL)
    np.testing.assert_allclose(von_mises(found), E * 0.02 * SMALL, rtol=1e-4)


def test_what_has_no_stress_says_so():
    for wrong, said in (
        (box((3, 3, 3)), "system has no cells"),
        (
            box((3, 3, 3), 0.1, material=stuff(0.4)).replace(spring=TensionOnlySpring()),
            "spring=TensionOnlySpring()",
        ),
    ):
        with pytest.raises(ValueError, match=re.escape(said)):
            stress(wrong)
    with pytest.raises(ValueError, match="position has shape"):
        stress(box((3, 3, 3), 0.1, material=stuff(0.4)), np.zeros((2, 3)))
