"""Users' functions that are compiled into kernels: what cannot be is refused before anything changes."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from msdwarp import Ensemble, Force, GroupMean, OwnSpring, Scene, Simulation, Wind, box

BODY = box((3, 3, 3), 0.1, mass=0.02, stiffness=400.0)


@wp.func
def of_two(x: Any, v: Any):
    return x


@wp.func
def undefined(x: Any, v: Any, t: Any, i: int):
    return nobody(x)  # noqa: F821  # pyright: ignore[reportUndefinedVariable]


@wp.func
def number(x: Any, v: Any, t: Any, i: int):
    return x[0]


@wp.func
def nothing(x: Any, v: Any, t: Any, i: int):
    pass


@wp.func
def drag(x: wp.vec3, v: wp.vec3, t: float, i: int):
    return -0.1 * v


@wp.func
def air(x: Any):
    return x


@wp.func
def place(x: wp.vec3d, v: wp.vec3d, i: int):
    return x


@wp.func
def twice(strain: Any):
    return 2.0 * strain


@wp.kernel
def a_kernel(x: wp.array(dtype=float)):
    x[wp.tid()] = 0.0


@wp.func
def as_vector(strain: Any):
    return wp.vec3(float(strain))


TAKEN = r"\(x: vec3f, v: vec3f, t: float32, i: int32\)"


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (of_two, rf"is of_two\(x, v\); it must be a wp.func {TAKEN}, or one of arguments annotated Any"),
        (undefined, rf"cannot be compiled for {TAKEN}: (?s:.)*undefined symbol: nobody"),
        (number, rf"returns float32 for {TAKEN}; it must return vec3f"),
        (nothing, rf"returns nothing for {TAKEN}; it must return vec3f"),
    ],
)
def test_a_force_that_cannot_be_compiled_changes_nothing(function, message):
    simulation = Simulation(BODY, device="cpu")
    simulation.step()
    with pytest.raises(ValueError, match=r"loads\[0\]\.force " + message):
        simulation.change(loads=[Force(function)])
    assert simulation.loads == ()
    simulation.step()
    assert simulation.frame_index == 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Simulation(BODY, loads=[Force(drag)], precision="float64", device="cpu"),
            r"force is drag\(x, v, t, i\); it must be a wp.func \(x: vec3d, v: vec3d, t: float64, i: int32\)",
        ),
        (
            lambda: Simulation(BODY, loads=[Wind(air, area=0.1)], device="cpu"),
            r"loads\[0\]\.velocity is air\(x\); it must be a wp.func \(x: vec3f, t: float32\)",
        ),
        (lambda: Simulation(BODY, loads=[Force(a_kernel)], device="cpu"), r"loads\[0\]\.force is .*a wp.func"),
        (lambda: OwnSpring(twice), r"function cannot be compiled for \(strain: float64\)"),
        (lambda: OwnSpring(as_vector), r"function returns vec3f for \(strain: float32\); it must return float32"),
    ],
)
def test_what_cannot_be_compiled_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(("width", "expected"), [(0, "float64"), (2, "vec2d"), (4, "vec4d"), (40, "length=40")])
def test_the_width_of_a_mean_is_what_its_function_returns(width, expected):
    # With 40 this ended Python by a segmentation fault, and with 4 it gave a fourth number.
    ensemble = Ensemble(Scene(system=BODY), 2, device="cpu")
    with pytest.raises(ValueError, match=rf"observe\['q'\]: function returns vec3d .* must return .*{expected}"):
        ensemble.run(0.05, observe={"q": GroupMean(place, width=width)})
    assert np.all(ensemble.frame().time == 0.0)
