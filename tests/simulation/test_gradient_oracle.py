"""Gradients beside other ways to find them, Warp's tape and complex numbers; and twice, to the last bit."""

import numpy as np
import pytest
import warp as wp
from differences import FRAMES, NAMES, SOFT, block, loss, simulation

import msdwarp as msd

SUBSTEPS, H = 6, 1 / 360
GRAVITY = wp.constant(wp.vec3d(0.0, 0.0, -9.82))


@wp.kernel
def pull(
    ends: wp.array(dtype=wp.vec2i),
    rest_length: wp.array(dtype=wp.float64),
    stiffness: wp.array(dtype=wp.float64),
    damping: wp.array(dtype=wp.float64),
    x: wp.array(dtype=wp.vec3d),
    v: wp.array(dtype=wp.vec3d),
    force: wp.array(dtype=wp.vec3d),
):
    c = wp.tid()
    i = ends[c][0]
    j = ends[c][1]
    dx = x[i] - x[j]
    length = wp.length(dx)
    along = stiffness[c] * (length - rest_length[c]) + damping[c] * wp.dot(v[i] - v[j], dx) / length
    wp.atomic_add(force, i, -along / length * dx)
    wp.atomic_add(force, j, along / length * dx)


@wp.kernel
def move(
    mass: wp.array(dtype=wp.float64),
    x: wp.array(dtype=wp.vec3d),
    v: wp.array(dtype=wp.vec3d),
    force: wp.array(dtype=wp.vec3d),
    x_out: wp.array(dtype=wp.vec3d),
    v_out: wp.array(dtype=wp.vec3d),
):
    i = wp.tid()
    v_new = v[i] + wp.float64(wp.static(H)) * (force[i] / mass[i] + GRAVITY)
    v_out[i] = v_new
    x_out[i] = x[i] + wp.float64(wp.static(H)) * v_new


@wp.kernel
def weigh(x: wp.array(dtype=wp.vec3d), v: wp.array(dtype=wp.vec3d), total: wp.array(dtype=wp.float64)):
    i = wp.tid()
    wp.atomic_add(total, 0, wp.dot(x[i], x[i]) + wp.float64(0.1) * wp.dot(v[i], v[i]))


def squares(found: msd.Frames) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the squares of positions, and a tenth of those of velocities, at the end."""
    by_x, by_v = np.zeros((2, *found.position.shape))
    by_x[-1], by_v[-1] = 2 * found.position[-1], 0.2 * found.velocity[-1]
    return float((found.position[-1] ** 2).sum() + 0.1 * (found.velocity[-1] ** 2).sum()), by_x, by_v


@pytest.mark.slow
def test_gradients_are_those_of_the_tape_of_warp(plain_device):
    body, frames = block(), 3
    body = body.replace(mass=np.where(np.isfinite(body.mass), body.mass, 0.03))
    names = ("position", "velocity", "stiffness", "damping", "rest_length", "mass")
    kinds = {"position": wp.vec3d, "velocity": wp.vec3d}
    arrays = {
        name: wp.array(getattr(body, name), dtype=kinds.get(name, wp.float64), device="cpu", requires_grad=True)
        for name in names
    }
    ends = wp.array(body.connections, dtype=wp.vec2i, device="cpu")
    springs = [ends, *(arrays[name] for name in ("rest_length", "stiffness", "damping"))]
    count, total = body.particle_count, wp.zeros(1, dtype=wp.float64, device="cpu", requires_grad=True)
    x, v, tape = arrays["position"], arrays["velocity"], wp.Tape()
    with tape:
        for _ in range(frames * SUBSTEPS):
            force, x_out, v_out = (wp.zeros_like(x) for _ in range(3))
            wp.launch(pull, len(ends), [*springs, x, v, force], device="cpu")
            wp.launch(move, count, [arrays["mass"], x, v, force, x_out, v_out], device="cpu")
            x, v = x_out, v_out
        wp.launch(weigh, count, [x, v, total], device="cpu")
    tape.backward(total)

    how = {"precision": "float64", "substeps": SUBSTEPS, "gravity": 9.82, "device": plain_device}
    run = msd.Simulation(body, integrator=msd.SymplecticEuler(), **how)
    gradient = run.gradient(squares, frames, by=names)
    assert gradient.value == pytest.approx(total.numpy()[0], rel=1e-13)
    for name in names:
        wanted = arrays[name].grad.numpy()
        # Both differentiate the same 18 substeps: hundreds of roundings of 1e-16, multiplied by a hundred at most.
        np.testing.assert_allclose(gradient[name], wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


def rates(x, v, ends, start):
    """Return the accelerations of particles, which may be complex, as their springs and forces give them."""
    i, j = ends.T
    dx, dv = x[i] - x[j], v[i] - v[j]
    length = np.sqrt((dx * dx).sum(axis=1))
    pull = start["stiffness"] * (length - start["rest_length"]) + start["damping"] * (dv * dx).sum(axis=1) / length
    force = start["force"] + 0j
    np.add.at(force, i, -(pull / length)[:, None] * dx)
    np.add.at(force, j, (pull / length)[:, None] * dx)
    return force / start["mass"][:, None] + start["gravity"]


@pytest.mark.slow
def test_gradients_by_rk4_are_those_of_complex_numbers(plain_device):
    body, frames = block(), 3
    body = body.replace(mass=np.where(np.isfinite(body.mass), body.mass, 0.03))
    names = ("position", "velocity", "stiffness", "damping", "rest_length", "mass", "gravity", "force")
    values = {name: getattr(body, name) for name in names[:-2]}
    values |= {"gravity": np.array([0.0, 0.0, -9.82]), "force": np.zeros(body.position.shape)}

    def run(start):
        """Return the loss below after substeps by the formulas of the textbook."""
        x, v = start["position"], start["velocity"]
        for _ in range(frames * SUBSTEPS):
            a = rates(x, v, body.connections, start)
            u, b = v + H / 2 * a, rates(x + H / 2 * v, v + H / 2 * a, body.connections, start)
            w, c = v + H / 2 * b, rates(x + H / 2 * u, v + H / 2 * b, body.connections, start)
            z, d = v + H * c, rates(x + H * w, v + H * c, body.connections, start)
            x, v = x + H / 6 * (v + 2 * u + 2 * w + z), v + H / 6 * (a + 2 * b + 2 * c + d)
        return (x**2).sum() + 0.1 * (v**2).sum()

    how = {"substeps": SUBSTEPS, "gravity": 9.82, "integrator": msd.RK4(), "device": plain_device}
    # In float64 it is hundreds of roundings of 1e-16, multiplied by a hundred at most; in float32 of 6e-8, that is
    # 1.5e-6 of strains of 0.04.
    for precision, tolerance in (("float64", 1e-12), ("float32", 1e-4)):
        gradient = msd.Simulation(body, precision=precision, **how).gradient(squares, frames, by=names)
        assert gradient.value == pytest.approx(run(values).real, rel=tolerance)
        for name in names:
            way = np.random.default_rng(1).normal(size=values[name].shape) * (np.abs(values[name]) + 0.1)
            # The imaginary part is the derivative times 1e-30, without a difference that would lose digits.
            wanted = run(values | {name: values[name] + 1e-30j * way}).imag / 1e-30
            terms = gradient[name] * way
            assert terms.sum() == pytest.approx(wanted, rel=0, abs=tolerance * np.linalg.norm(terms))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "algorithm"),
    [
        (msd.Leapfrog(), "gather"),
        pytest.param(msd.RK4(), "stencil", marks=pytest.mark.slow),
    ],
)
def test_gradients_repeat_to_the_last_bit(method, algorithm, plain_device):
    body, loads = block(), [msd.EnclosedGas(60.0), msd.Wind((3.0, 1.0, -2.0), drag=1.0, lift=0.5)]
    if algorithm == "stencil":  # which needs a uniform lattice
        body = msd.box((4, 3, 3), 0.1, stiffness=300.0, damping=0.3)
    how = {"colliders": [msd.Plane((0.1, 0, 1), -0.1, **SOFT)], "loads": loads, "device": plain_device}
    first, second = (
        simulation(body, integrator=method, force_algorithm=algorithm, **how).gradient(
            loss, FRAMES, by=(*NAMES, "force")
        )
        for _ in range(2)
    )
    for name in (*NAMES, "force"):
        np.testing.assert_array_equal(second[name], first[name])
