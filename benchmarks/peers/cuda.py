"""Hand-written CUDA, compiled by CuPy: yardsticks of what the chip allows, not simulators.

The kernels compute what msdwarp's symplectic Euler does, its floor and its Coulomb rule included, in float32
with approximate square roots and divisions (--use_fast_math). A record of 16 bytes holds a position and the
inverse mass, another a velocity. They know more than a simulator may: one stiffness and one damping for all
connections, and the lattice kernels the lattice, so that they read neither indices nor rest lengths.

- `Marching`: a thread marches up DEPTH particles of a column. Each plane's nine records are read once for the
  three particles of the column that they pull: 10 records a particle at great depth, 27 at depth 1, of which
  all but one are hits of the L1 cache, which is as fast as shared memory. DRAM sees at least 64 bytes a
  particle and step. Every connection is computed twice. The fastest depth is measured for each body.
- `Lanes`: 2, 4 or 8 threads share a particle, take its neighbours in turn, and add up by shuffles: for bodies too
  small to fill the chip with a thread for each particle. The fastest number is measured for each body.
- `OneBlock`: bodies of up to 1024 particles stay in the shared memory of one multiprocessor for many steps,
  so that a step costs two barriers and no launch.
- `Scatter`: a thread per connection, an index pair and a rest length read, forces added by 16-byte atomics
  (one instruction from compute capability 9.0 on); then a thread per particle. It knows no lattice.
"""

import math

import numpy as np
from numpy.typing import NDArray

from .cuda_kernels import COMMON, LANES, LATTICE, ONE_BLOCK, SCATTER

DEPTHS = (1, 2, 4, 8, 16)
LEAST_THREADS = 16_384
"""A depth is tried where this many threads are left."""
MOST_WITH_LANES = 300_000
"""Larger bodies have threads enough with one for each particle."""
BLOCK = 256
"""Threads of a block, at most."""


class Unsuitable(Exception):
    """A peer cannot, or cannot sensibly, simulate a body; the message says why."""


class Cuda:
    """What they have in common: records on the device, a stream, and steps as a graph of launches."""

    def __init__(self, body, device: str) -> None:
        if not device.startswith("cuda"):
            raise Unsuitable("needs a GPU")
        import cupy

        self.cupy, self.note, self.graphs = cupy, "", {}
        cupy.cuda.Device(int(device.partition(":")[2] or 0)).use()
        self.stream = cupy.cuda.Stream(non_blocking=True)
        self.order = self.particle_order(body)
        system = body.system
        x = np.column_stack([system.position, 1.0 / system.mass])[self.order]
        v = np.column_stack([system.velocity, np.zeros(len(x))])[self.order]
        with self.stream:
            self.x, self.v = (cupy.asarray(a, dtype=cupy.float32) for a in (x, v))
        numbers = (system.stiffness[0], system.damping[0], body.step, body.gravity, body.floor)
        names = ("STIFFNESS", "DAMPING", "STEP", "GRAVITY", "FLOOR")
        self.constants = {name: f"{float(n)!r}f" for name, n in zip(names, numbers, strict=True)}

    def particle_order(self, body) -> NDArray:
        """Return which of the body's particles each record holds."""
        return np.arange(body.system.particle_count)

    def compiled(self, source: str, **sizes: int):
        """Return the module compiled with the body's numbers as constants."""
        defines = "".join(f"#define {key} {value}\n" for key, value in (self.constants | sizes).items())
        options = ("--use_fast_math", "-std=c++17")
        return self.cupy.RawModule(code=defines + COMMON + source, options=options)

    def launch(self, kernel, grid: tuple, block: tuple, *arguments) -> None:
        """Launch a kernel on this peer's stream."""
        with self.stream:
            kernel(grid, block, arguments)

    def record(self, steps: int) -> None:
        """Launch the kernels of so many steps."""
        raise NotImplementedError

    def advance(self, steps: int) -> None:
        """Replay the graph of so many steps; the first time, record it."""
        self.cupy.cuda.Device().use()  # other libraries may have left another context current
        with self.stream:
            if steps not in self.graphs:
                self.stream.begin_capture()
                self.record(steps)
                self.graphs[steps] = self.stream.end_capture()
            self.graphs[steps].launch(self.stream)

    def synchronise(self) -> None:
        """Wait until the device is done."""
        self.stream.synchronize()

    def position(self) -> NDArray:
        """Return the positions of the body's particles [m]."""
        found = np.empty((len(self.order), 3))
        found[self.order] = self.cupy.asnumpy(self.x, stream=self.stream)[:, :3]
        return found


class Lattice(Cuda):
    """What the lattice kernels share: the longest axis comes first, so that neighbours lie side by side."""

    def particle_order(self, body) -> NDArray:
        """Return which of the body's particles each record holds."""
        if body.shape is None:
            raise Unsuitable("no lattice")
        index = np.arange(body.system.particle_count).reshape(body.shape[::-1])
        index = index.transpose(np.argsort(index.shape, kind="stable"))
        self.sizes = dict(zip(("NX", "NY", "NZ"), index.shape[::-1], strict=True))
        return index.ravel()


class TwoBuffers(Lattice):
    """One kernel a step over the lattice, between two pairs of buffers; which kernel is fastest is measured."""

    def __init__(self, body, device: str) -> None:
        super().__init__(body, device)
        self.other = [self.cupy.empty_like(a) for a in (self.x, self.v)]
        choices = self.choices()
        seconds = {choice: self.trial(choice) for choice in choices}
        best = min(choices, key=seconds.__getitem__)
        self.use(best)
        self.note = self.named(best)

    def choices(self) -> list:
        """Return the kernels that are tried."""
        raise NotImplementedError

    def use(self, choice) -> None:
        """Take one of these kernels."""
        raise NotImplementedError

    def named(self, choice) -> str:
        """Say in words which it is."""
        raise NotImplementedError

    def trial(self, choice) -> float:
        """Return the milliseconds that ten launches take; the body stays as it is."""
        self.use(choice)
        start, end = self.cupy.cuda.Event(), self.cupy.cuda.Event()
        for k in range(12):
            if k == 2:
                start.record(self.stream)
            self.launch(self.kernel, self.grid, self.block, self.x, self.v, *self.other)
        end.record(self.stream)
        end.synchronize()
        return self.cupy.cuda.get_elapsed_time(start, end)

    def record(self, steps: int) -> None:
        """Launch a kernel a step, there and back."""
        if steps % 2:
            raise ValueError(f"steps is {steps}; it must be even")
        here, there = [self.x, self.v], self.other
        for _ in range(steps):
            self.launch(self.kernel, self.grid, self.block, *here, *there)
            here, there = there, here


class Marching(TwoBuffers):
    """A thread marches up a column; see the module."""

    def choices(self) -> list:
        """Return depths."""
        nx, ny, nz = self.sizes.values()
        width = math.ceil(nx / math.ceil(nx / 32))
        self.block = (width, min(ny, BLOCK // width), 1)
        return [d for d in DEPTHS if d == 1 or (d <= nz and len(self.x) >= LEAST_THREADS * d)]

    def use(self, choice) -> None:
        """Take the kernel of this depth."""
        self.kernel = self.compiled(LATTICE, DEPTH=choice, BLOCK=BLOCK, **self.sizes).get_function("lattice_step")
        spans = (self.block[0], self.block[1], choice)
        self.grid = tuple(math.ceil(n / span) for n, span in zip(self.sizes.values(), spans, strict=True))

    def named(self, choice) -> str:
        """Name block and depth."""
        return f"blocks of {self.block[0]} x {self.block[1]}, depth {choice}"


class Lanes(TwoBuffers):
    """Several threads share a particle; see the module."""

    def choices(self) -> list:
        """Return numbers of threads that share a particle, with those in a block."""
        if len(self.x) > MOST_WITH_LANES:
            raise Unsuitable("enough particles for a thread each")
        return [(lanes, block) for lanes in (2, 4, 8) for block in (64, 128, 256)]

    def use(self, choice) -> None:
        """Take the kernel of so many lanes, in such blocks."""
        lanes, block = choice
        self.kernel = self.compiled(LANES, LANES=lanes, BLOCK=block, **self.sizes).get_function("lanes_step")
        self.grid, self.block = (math.ceil(len(self.x) * lanes / block),), (block,)

    def named(self, choice) -> str:
        """Name lanes and block."""
        return f"{choice[0]} threads to a particle, blocks of {choice[1]}"


class OneBlock(Lattice):
    """All steps in one launch of one block; see the module."""

    def __init__(self, body, device: str) -> None:
        if body.system.particle_count > 1024:
            raise Unsuitable("more than 1024 particles")
        super().__init__(body, device)
        self.kernel = self.compiled(ONE_BLOCK, **self.sizes).get_function("one_block_steps")
        self.record(0)  # loads the kernel, which a capture should not

    def record(self, steps: int) -> None:
        """Launch all steps at once."""
        threads = 32 * math.ceil(len(self.x) / 32)
        self.launch(self.kernel, (1,), (threads,), self.x, self.v, np.int32(steps))


class Scatter(Cuda):
    """A kernel over the connections with atomics, and one over the particles; see the module."""

    def __init__(self, body, device: str) -> None:
        super().__init__(body, device)
        cupy, system = self.cupy, body.system
        with self.stream:
            self.f = cupy.zeros_like(self.x)
            self.connections = cupy.asarray(system.connections)
            self.rest_length = cupy.asarray(system.rest_length, dtype=cupy.float32)
        module = self.compiled(SCATTER, BLOCK=BLOCK)
        self.scatter, self.integrate = module.get_function("scatter_forces"), module.get_function("integrate")
        self.step(0, 0)  # loads the kernels, which a capture should not

    def step(self, connections: int, particles: int) -> None:
        """Launch the two kernels for so many connections and particles."""
        grids = [(max(1, math.ceil(count / BLOCK)),) for count in (connections, particles)]
        state = (self.x, self.v, self.f)
        lists = (self.connections, self.rest_length)
        self.launch(self.scatter, grids[0], (BLOCK,), *lists, *state, np.int32(connections))
        self.launch(self.integrate, grids[1], (BLOCK,), *state, np.int32(particles))

    def record(self, steps: int) -> None:
        """Launch two kernels a step."""
        for _ in range(steps):
            self.step(len(self.rest_length), len(self.x))
