"""Users' functions that are compiled into kernels: what cannot be is refused before anything changes."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from msdwarp import Contact, Ensemble, Force, GroupMean, OwnDamper, OwnSpring, Scene, Simulation, Wind, box

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


def a_sum(values):
    """Return a function of one number: their sum times it, for which each value is known in a loop only."""

    @wp.func
    def times_sum(x: Any):
        result = type(x)(0.0)
        for k in range(wp.static(len(values))):
            result += type(x)(wp.static(values[k])) * x
        return result

    return times_sum


def own_spring(values):
    return {"spring": OwnSpring(a_sum(values))}


def own_damper(values):
    called = a_sum(values)

    @wp.func
    def law(strain: Any, rate: Any, damping: Any):
        return damping * called(rate)

    return {"damper": OwnDamper(law)}


def own_force(values):
    called = a_sum(values)

    @wp.func
    def pull(x: wp.vec3, v: wp.vec3, t: float, i: int):
        return wp.vec3(0.0, 0.0, called(0.1))

    return {"loads": [Force(pull)]}


def own_wind(values):
    called = a_sum(values)

    @wp.func
    def blow(x: wp.vec3, t: float):
        return wp.vec3(called(1.0), 0.0, 0.0)

    return {"loads": [Wind(blow)]}


def moved(what, device, route):
    """Return where a body is after some frames with a law or a load."""
    loads = what.pop("loads", [])
    body = BODY.replace(position=1.1 * BODY.position, damping=np.full(BODY.connection_count, 0.5), **what)
    how: dict[str, Any] = {"gravity": 0.0, "substeps": 20, "device": device}
    if route == "worlds":
        worlds = Ensemble(Scene(system=body, loads=loads, gravity=0.0), worlds=2, substeps=20, device=device)
        worlds.step(3)
        return worlds.frame()[1]
    if route == "threads":
        how["threads"] = 2 if device == "cpu" else "auto"
    elif route == "contact":
        how["contact"] = Contact()
    else:
        how["force_algorithm"] = route
    simulation = Simulation(body, loads=loads, **how)
    simulation.step(3)
    return simulation.frame().position


@pytest.mark.parametrize("make", [own_spring, own_damper, own_force, own_wind])
@pytest.mark.parametrize("route", ["gather", "scatter", "stencil", "threads", "worlds", "contact"])
@pytest.mark.each_value
def test_a_function_defined_again_is_the_same_and_one_of_other_values_another(plain_device, make, route):
    first, other, again = (moved(make(one), plain_device, route) for one in [(1.0, 0.5), (1.0, 4.0), (1.0, 0.5)])
    # Of 0.1 m. The order of atomic sums differs on a GPU, by the last bit of float32 in each of 60 substeps.
    np.testing.assert_allclose(again, first, rtol=0, atol=0 if plain_device == "cpu" else 1e-6)
    assert np.abs(other - first).max() > 1e-5


def test_values_in_loops_make_the_force(plain_device):
    system = BODY.replace(position=1.1 * BODY.position)
    for values in [(1.0, 0.5), (1.0, 4.0)]:
        scaled = system.replace(stiffness=sum(values) * system.stiffness)
        ends = []
        for one in (system.replace(**own_spring(values)), scaled):
            simulation = Simulation(one, gravity=0.0, substeps=20, device=plain_device)
            simulation.step(2)
            ends.append(simulation.frame().position)
        # Of 0.1 m: k l0 (c ε) is rounded in another order than (c k) l0 ε, in 40 substeps in float32.
        np.testing.assert_allclose(*ends, rtol=0, atol=1e-6)
