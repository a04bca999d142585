"""Gradients beside another way to find them, Warp's tape over plain kernels; and twice, to the last bit."""

import numpy as np
import pytest
import warp as wp
from differences import FRAMES, METHODS, NAMES, SOFT, block, loss, simulation

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

    def same(found: msd.Frames) -> tuple[float, np.ndarray, np.ndarray]:
        by_x, by_v = np.zeros((2, *found.position.shape))
        by_x[-1], by_v[-1] = 2 * found.position[-1], 0.2 * found.velocity[-1]
        return float((found.position[-1] ** 2).sum() + 0.1 * (found.velocity[-1] ** 2).sum()), by_x, by_v

    how = {"precision": "float64", "substeps": SUBSTEPS, "gravity": 9.82, "device": plain_device}
    run = msd.Simulation(body, integrator=msd.SymplecticEuler(), **how)
    gradient = run.gradient(same, frames, by=names)
    assert gradient.value == pytest.approx(total.numpy()[0], rel=1e-13)
    for name in names:
        wanted = arrays[name].grad.numpy()
        # Both differentiate the same 18 substeps: hundreds of roundings of 1e-16, multiplied by a hundred at most.
        np.testing.assert_allclose(gradient[name], wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("algorithm", ["gather", "stencil"])
@pytest.mark.parametrize("method", METHODS)
def test_gradients_repeat_to_the_last_bit(algorithm, method, plain_device):
    body, loads = block(), [msd.EnclosedGas(60.0), msd.Wind((3.0, 1.0, -2.0), drag=1.0, lift=0.5)]
    if algorithm == "stencil":  # which needs a uniform lattice
        body = msd.box((4, 3, 3), 0.1, stiffness=300.0, damping=0.3)
    how = {"colliders": [msd.Plane((0.1, 0, 1), -0.1, **SOFT)], "loads": loads, "device": plain_device}
    first, second = (
        simulation(body, integrator=METHODS[method], force_algorithm=algorithm, **how).gradient(
            loss, FRAMES, by=(*NAMES, "force")
        )
        for _ in range(2)
    )
    for name in (*NAMES, "force"):
        np.testing.assert_array_equal(second[name], first[name])
