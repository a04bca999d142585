"""The peers that run anywhere: msdwarp itself, newton, Taichi, Numba and NumPy, behind one small interface.

A peer is built from a body (`compare.Body`) and a device; `advance(steps)` takes so many steps, perhaps
asynchronously; `synchronise()` waits for them; `position()` returns what they led to. What each does and lacks
is in its docstring. All are float32 and all have gravity and pinned particles.
"""

import importlib
import inspect
import math
import time

import numpy as np
import warp as wp
from numpy.typing import NDArray

from msdwarp import Plane, Simulation

from .cuda import Unsuitable

NUMPY_MOST = 1_000_000
"""Connections of the largest body for NumPy: a step of 64³ particles would take a second."""


class Msdwarp:
    """msdwarp's `Simulation`, contact with a floor and the watch over divergence (once an `advance`) included."""

    def __init__(self, body, device: str, force_algorithm: str = "auto") -> None:
        self.body, self.device, self.options = body, device, {"force_algorithm": force_algorithm}
        if "force_algorithm" not in inspect.signature(Simulation).parameters:
            if force_algorithm != "auto":
                raise Unsuitable("this version of msdwarp has one algorithm only")
            self.options = {}
        self.simulation, self.note = None, ""

    def advance(self, steps: int) -> None:
        """Take so many steps, one frame; the graph of a frame is recorded when their number changes."""
        if self.simulation is None or self.simulation.substeps != steps:
            self.simulation = Simulation(
                self.simulation.snapshot() if self.simulation else self.body.system,
                gravity=self.body.gravity,
                colliders=[Plane(offset=self.body.floor)],
                fps=1 / (steps * self.body.step),
                substeps=steps,
                allow_unstable=True,
                energy_limit=math.inf,
                device=self.device,
                precision="float32",
                **self.options,
            )
        self.simulation.step()

    def synchronise(self) -> None:
        """Wait until the device is done."""
        wp.synchronize_device(self.device)

    def position(self) -> NDArray:
        """Return the positions [m]."""
        return self.simulation.frame().position.astype(np.float64)


class Newton:
    """newton's SolverSemiImplicit: springs scattered by atomics, then particles; recorded as a graph on CUDA.

    There is no contact: particles have radius 0 and no contacts are passed, so that newton searches none; its
    contact with a plane is a penalty force found by a collision pipeline, another law. A spring has its own rest
    length, stiffness and damping and reads 20 bytes of them and its particles' indices.
    """

    def __init__(
        self,
        body,
        device: str,
        solver=lambda newton, model: newton.solvers.SolverSemiImplicit(model),
        by_particle: bool = False,
    ):
        newton = importlib.import_module("newton")
        self.newton, self.device, self.step_length, self.note = newton, device, body.step, newton.__version__
        model = newton_model(newton, body, device, by_particle=by_particle)
        self.solver = solver(newton, model)
        self.here, self.there = model.state(), model.state()
        self.graphs = {}

    def run(self, steps: int) -> None:
        """Take so many steps by launching kernels."""
        for _ in range(steps):
            self.here.clear_forces()
            self.solver.step(self.here, self.there, None, None, self.step_length)
            self.here, self.there = self.there, self.here

    def advance(self, steps: int) -> None:
        """Take so many steps; on CUDA by a graph that is recorded the first time, after two steps to compile."""
        if self.device == "cpu":
            return self.run(steps)
        if not self.graphs:
            start = self.here.particle_q.numpy(), self.here.particle_qd.numpy()
            self.run(2)
            self.here.particle_q.assign(start[0])
            self.here.particle_qd.assign(start[1])
        if steps not in self.graphs:
            if steps % 2:
                raise ValueError(f"steps is {steps}; it must be even")
            with wp.ScopedCapture(device=self.device) as capture:
                self.run(steps)
            self.graphs[steps] = capture.graph
        wp.capture_launch(self.graphs[steps])

    def synchronise(self) -> None:
        """Wait until the device is done."""
        wp.synchronize_device(self.device)

    def position(self) -> NDArray:
        """Return the positions [m]."""
        return self.here.particle_q.numpy().astype(np.float64)


def newton_model(newton, body, device: str, colors=None, by_particle: bool = False, requires_grad: bool = False):
    """Return newton's model of a body; the builder's lists are given as whole arrays, for a body may be large.

    Springs are in the order of the system's connections, direction after direction, in which atomics seldom wait
    for each other; or `by_particle`, all of a particle before the next one's, as a program's loop would add them.
    """
    system, n, c = body.system, body.system.particle_count, body.system.connection_count
    order = np.argsort(system.connections[:, 0], kind="stable") if by_particle else slice(None)
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -body.gravity))
    builder.particle_q = system.position.astype(np.float32)
    builder.particle_qd = system.velocity.astype(np.float32)
    builder.particle_mass = np.where(system.pinned, 0, system.mass).astype(np.float32)
    builder.particle_radius = np.zeros(n, np.float32)
    builder.particle_flags = np.full(n, int(newton.ParticleFlags.ACTIVE), np.int32)
    builder.particle_world = np.full(n, -1, np.int32)
    builder.spring_indices = system.connections[order].ravel()
    builder.spring_rest_length = system.rest_length[order].astype(np.float32)
    builder.spring_stiffness = system.stiffness[order].astype(np.float32)
    builder.spring_damping = system.damping[order].astype(np.float32)
    builder.spring_control = np.zeros(c, np.float32)
    if colors is not None:
        builder.set_coloring(colors)
    return builder.finalize(device=device, requires_grad=requires_grad)


class Taichi:
    """A plain Taichi program: scatter over connections by atomics, then particles; no contact.

    Taichi records no graphs on CUDA; ten steps are compiled into each kernel, twenty launches from C++. On the
    CPU it runs on one thread. Rest lengths are read, one stiffness and one damping are arguments.
    """

    STEPS = 10

    def __init__(self, body, device: str) -> None:
        ti = importlib.import_module("taichi")
        if not ti.lang.impl.get_runtime().prog:
            ti.init(arch=ti.cuda if device != "cpu" else ti.cpu, log_level=ti.ERROR, cpu_max_num_threads=1)
        if device != "cpu" and ti.lang.impl.current_cfg().arch != ti.cuda:
            raise RuntimeError("Taichi found no CUDA device")
        self.ti, self.steps, self.note = ti, taichi_kernel(ti, self.STEPS), ti.__version__
        if isinstance(self.note, tuple):
            self.note = ".".join(map(str, self.note))
        system, n = body.system, body.system.particle_count

        def upload(values: NDArray, shape: tuple, dtype):
            array = ti.ndarray(dtype, shape)
            array.from_numpy(np.ascontiguousarray(values))
            return array

        vec3, pair = ti.types.vector(3, ti.f32), ti.types.vector(2, ti.i32)
        with np.errstate(divide="ignore"):
            inverse_mass = (1 / system.mass).astype(np.float32)
        self.lists = [
            upload(system.connections, (system.connection_count,), pair),
            upload(system.rest_length.astype(np.float32), (system.connection_count,), ti.f32),
            upload(inverse_mass, (n,), ti.f32),
        ]
        self.x = upload(system.position.astype(np.float32), (n,), vec3)
        self.v = upload(system.velocity.astype(np.float32), (n,), vec3)
        self.f = upload(np.zeros((n, 3), np.float32), (n,), vec3)
        numbers = (system.stiffness[0], system.damping[0], body.step, body.gravity)
        self.numbers = [float(number) for number in numbers]

    def advance(self, steps: int) -> None:
        """Launch a kernel for every ten steps."""
        if steps % self.STEPS:
            raise ValueError(f"steps is {steps}; it must be a multiple of {self.STEPS}")
        for _ in range(steps // self.STEPS):
            self.steps(*self.lists, self.x, self.v, self.f, *self.numbers)

    def synchronise(self) -> None:
        """Wait until the device is done."""
        self.ti.sync()

    def position(self) -> NDArray:
        """Return the positions [m]."""
        return self.x.to_numpy().astype(np.float64)


def taichi_kernel(ti, count: int):
    """Return the Taichi kernel of `count` steps, compiled once."""
    if hasattr(taichi_kernel, "kernel"):
        return taichi_kernel.kernel
    vec3, pair = ti.types.vector(3, ti.f32), ti.types.vector(2, ti.i32)

    @ti.kernel
    def steps(
        connections: ti.types.ndarray(dtype=pair, ndim=1),
        rest_length: ti.types.ndarray(dtype=ti.f32, ndim=1),
        inverse_mass: ti.types.ndarray(dtype=ti.f32, ndim=1),
        x: ti.types.ndarray(dtype=vec3, ndim=1),
        v: ti.types.ndarray(dtype=vec3, ndim=1),
        f: ti.types.ndarray(dtype=vec3, ndim=1),
        stiffness: ti.f32,
        damping: ti.f32,
        h: ti.f32,
        gravity: ti.f32,
    ):
        for _ in ti.static(range(count)):  # unrolled, so that each loop below is a launch over all its elements
            for c in range(rest_length.shape[0]):
                i, j = connections[c][0], connections[c][1]
                dx, dv = x[i] - x[j], v[i] - v[j]
                length = dx.norm()
                axis = dx / length
                force = -(stiffness * (length - rest_length[c]) + damping * dv.dot(axis)) * axis
                f[i] += force
                f[j] -= force
            for p in range(inverse_mass.shape[0]):
                w = inverse_mass[p]
                if w > 0:
                    v[p] += h * (w * f[p] - ti.Vector([0.0, 0.0, gravity]))
                    x[p] += h * v[p]
                f[p] = ti.Vector([0.0, 0.0, 0.0])

    taichi_kernel.kernel = steps
    return steps


class OnTheHost:
    """What the peers share that run on one core, whatever the device: arrays, and steps taken at once."""

    def __init__(self, body) -> None:
        system = body.system
        with np.errstate(divide="ignore"):
            self.inverse_mass = (1 / system.mass).astype(np.float32)
        self.x, self.v = system.position.astype(np.float32), system.velocity.astype(np.float32)
        self.rest_length = system.rest_length.astype(np.float32)
        self.connections, self.note = system.connections, "one core"
        numbers = (system.stiffness[0], system.damping[0], body.step, body.gravity)
        self.numbers = [np.float32(number) for number in numbers]

    def synchronise(self) -> None:
        """Nothing to wait for."""

    def position(self) -> NDArray:
        """Return the positions [m]."""
        return self.x.astype(np.float64)


class Numba(OnTheHost):
    """Two loops compiled by Numba (fastmath) on one CPU core; no contact."""

    def __init__(self, body, device: str) -> None:
        super().__init__(body)
        self.steps = numba_steps(importlib.import_module("numba"))
        self.f = np.zeros_like(self.x)
        self.advance(0)  # compiles

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        lists = (self.connections, self.rest_length, self.inverse_mass)
        self.steps(*lists, self.x, self.v, self.f, *self.numbers, steps)


def numba_steps(numba):
    """Return the loops, compiled once."""
    if hasattr(numba_steps, "compiled"):
        return numba_steps.compiled

    @numba.njit(fastmath=True)
    def steps(connections, rest_length, inverse_mass, x, v, f, stiffness, damping, h, gravity, count):
        for _ in range(count):
            for c in range(len(rest_length)):
                i, j = connections[c, 0], connections[c, 1]
                dx, dy, dz = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
                dv = (v[i, 0] - v[j, 0]) * dx + (v[i, 1] - v[j, 1]) * dy + (v[i, 2] - v[j, 2]) * dz
                length = math.sqrt(dx * dx + dy * dy + dz * dz)
                s = -(stiffness * (length - rest_length[c]) + damping * dv / length) / length
                f[i, 0] += s * dx
                f[i, 1] += s * dy
                f[i, 2] += s * dz
                f[j, 0] -= s * dx
                f[j, 1] -= s * dy
                f[j, 2] -= s * dz
            for p in range(len(inverse_mass)):
                w = inverse_mass[p]
                if w > 0:
                    v[p, 0] += h * (w * f[p, 0])
                    v[p, 1] += h * (w * f[p, 1])
                    v[p, 2] += h * (w * f[p, 2] - gravity)
                    for d in range(3):
                        x[p, d] += h * v[p, d]
                for d in range(3):
                    f[p, d] = 0

    numba_steps.compiled = steps
    return steps


class Numpy(OnTheHost):
    """Whole-array NumPy on one core, forces summed by bincount (which adds in float64); no contact."""

    def __init__(self, body, device: str) -> None:
        if body.system.connection_count > NUMPY_MOST:
            raise Unsuitable(f"more than {NUMPY_MOST} connections")
        super().__init__(body)

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        i, j = self.connections.T
        stiffness, damping, h, gravity = self.numbers
        for _ in range(steps):
            dx, dv = self.x[i] - self.x[j], self.v[i] - self.v[j]
            length = np.sqrt(np.einsum("cd,cd->c", dx, dx))
            speed = np.einsum("cd,cd->c", dv, dx) / length
            s = -(stiffness * (length - self.rest_length) + damping * speed) / length
            force = s[:, None] * dx
            for d in range(3):
                count, along = len(self.x), force[:, d]
                f = np.bincount(i, along, count) - np.bincount(j, along, count)
                a = self.inverse_mass * f.astype(np.float32) - (gravity if d == 2 else np.float32(0))
                self.v[:, d] += h * np.where(self.inverse_mass > 0, a, np.float32(0))
            self.x += h * self.v


def steps_in(peer, seconds: float, most: int) -> int:
    """Return how many steps a peer takes in about so many seconds, at least one."""
    peer.synchronise()
    start = time.perf_counter()
    peer.advance(1)
    peer.synchronise()
    return max(1, min(most, int(seconds / (time.perf_counter() - start))))
