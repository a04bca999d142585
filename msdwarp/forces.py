"""The routes to the forces, as a model needs them: what their kernels read, on the device.

`data` is the struct that the functions of `route` read; see `msdwarp.kernels.forces`.
"""

from typing import Any

import numpy as np
import warp as wp

from .kernels import implicit, tables
from .kernels.forces import CONSTANTS, SLICE, gather, scatter, stencil
from .kernels.stability import add_blocks
from .model import Model


class Scatter:
    """The route by connections."""

    def __init__(self, model: Model) -> None:
        varying = _varying(model)
        self.route = scatter(model.dim, model.scalar, model.damped, model.compensated, varying)
        self.data = self.route.Forces()
        self.data.f, self.data.connections = model.vectors(), model.connections
        for name in CONSTANTS:
            setattr(self.data, name, getattr(model, name) if name in varying else _only(model, name))


class Gather:
    """The route by particles, with a table of neighbours that is built on the device."""

    def __init__(self, model: Model) -> None:
        varying = _varying(model)
        self.route = gather(model.dim, model.scalar, model.damped, model.compensated, varying)
        self.data = self.route.Forces()
        self.data.first, self.data.other, connection = neighbour_table(model)
        for name in CONSTANTS:
            if name in varying:
                setattr(self.data, name, _by_slot(model, getattr(model, name), connection))
            else:
                setattr(self.data, name, _only(model, name))


def _varying(model: Model) -> tuple[str, ...]:
    """Return the constants of which connections have their own."""
    system = model.system
    return tuple(name for name in CONSTANTS if len(values := getattr(system, name)) and values.strides != (0,))


def _only(model: Model, name: str) -> float:
    """Return a constant that all connections share, 0 if there are none."""
    return float(next(iter(getattr(model.system, name)), 0.0))


def _by_slot(model: Model, values: wp.array, connection: wp.array) -> wp.array:
    """Return a constant of each slot's connection."""
    slots = wp.ones(len(connection), dtype=model.scalar, device=model.device)
    inputs = [connection, values]
    wp.launch(tables.take(model.scalar), len(connection), inputs, [slots], device=model.device)
    return slots


def neighbour_table(model: Model) -> tuple[wp.array, wp.array, wp.array]:
    """Return (first, other, connection): where slices of the table begin, and what each slot names.

    The slots of a particle are in the order of its connections, whatever the device; slots that pad name no
    connection (−1), and the particle itself.
    """
    n, ends, device = model.particle_count, 2 * model.connection_count, model.device

    def integers(size: int) -> wp.array:
        return wp.zeros(size, dtype=int, device=device)

    def launch(kernel: Any, threads: int, inputs: list, outputs: list) -> None:
        wp.launch(kernel, threads, inputs, outputs, device=device)

    particle, end = integers(2 * ends), integers(2 * ends)  # sorting needs as much again
    launch(tables.list_ends, model.connection_count, [model.connections], [particle, end])
    wp.utils.radix_sort_pairs(particle, end, ends)
    count, start = integers(n), integers(n)
    launch(tables.count_ends, ends, [particle], [count])
    wp.utils.array_scan(count, start, inclusive=False)
    slices = -(-n // SLICE)
    length, first = integers(slices + 1), integers(slices + 1)
    launch(tables.measure_slices, slices, [count], [length])
    wp.utils.array_scan(length, first, inclusive=False)
    slots = int(first[slices:].numpy()[0])
    other, connection = integers(slots), wp.full(slots, -1, dtype=int, device=device)
    launch(tables.name_itself, slices, [first], [other, n])
    launch(tables.fill_slots, ends, [particle, end, start, first, model.connections], [other, connection])
    return first, other, connection


class Stencil:
    """The route by particles of lattices, which need no table."""

    def __init__(self, model: Model) -> None:
        lattice, device = model.lattice, model.device
        assert lattice is not None
        kinds = (model.dim, model.scalar, model.damped, model.compensated)
        self.route = stencil(*kinds, lattice.steps, lattice.uniform)
        data = self.data = self.route.Forces()
        data.mask = wp.array(lattice.mask, dtype=wp.uint32, device=device)
        if lattice.uniform:
            data.shift = wp.types.vector(len(lattice.shift), int)(*map(int, lattice.shift))
            for name in CONSTANTS:
                values = lattice.constants[name][0]
                setattr(data, name, wp.types.vector(len(values), model.scalar)(*map(float, values)))
            return
        shift = lattice.shift
        if shift.ndim == 1:
            shift = np.repeat(shift[:, None], model.particle_count, axis=1)
        data.shift = wp.array(shift, dtype=int, device=device)
        data.kind = wp.array(lattice.kind, dtype=int, device=device)
        for name in CONSTANTS:
            setattr(data, name, wp.array(lattice.constants[name], dtype=model.scalar, device=device))


ROUTE_CLASSES = {"scatter": Scatter, "gather": Gather, "stencil": Stencil}


def add_linearised(
    model: Model, x: wp.array, p: wp.array, z: wp.array, *, spring: float, damper: float, scale: float
) -> None:
    """Add scale (spring·K + damper·B) p to z, K and B linearised at x; by scattering, whatever the route."""
    if model.connection_count:
        constants = [model.connections, model.rest_length, model.stiffness, model.damping]
        wp.launch(
            implicit.add_linearised(model.dim, model.scalar),
            dim=model.connection_count,
            inputs=[*constants, model.inverse_mass, x, p, spring, damper, scale],
            outputs=[z],
            device=model.device,
        )


def write_diagonal_blocks(model: Model, x: wp.array, springs: wp.array, dampers: wp.array) -> None:
    """Write the diagonal blocks of K and B at x, float64 matrices of shape [particle_count]."""
    springs.zero_()
    dampers.zero_()
    if model.connection_count:
        wp.launch(
            add_blocks(model.dim, model.scalar),
            dim=model.connection_count,
            inputs=[model.connections, model.rest_length, model.stiffness, model.damping, x],
            outputs=[springs, dampers],
            device=model.device,
        )
