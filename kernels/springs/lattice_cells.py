"""Solid cells of a lattice that resist a change of volume: a pressure per cell, and forces on cell faces.

The law is as in `cell_volumes`. In a regularly numbered lattice a particle finds cells and neighbours by adding
constants to its own index. Each face between two of the eight cells around a particle is in the forces −p ∂V/∂x of
both, with opposite signs, so there are 12 faces. A face with corners at r₂, r₃, r₄ relative to the particle,
counter-clockwise as seen from the cell above, exerts

    (p_above − p_below) (r₂ × (r₃ + r₄) + r₃ × r₄)/12
"""

import functools
from typing import Any

import warp as wp

from ..basis import kernel
from ..compensation import state_types
from ..effect import ForceTerm, instant
from ..records import records
from .cell_geometry import cell_geometry
from .cell_volumes import cell_pressure, cell_table
from .force_algorithm import difference


@functools.cache
def lattice_cells(scalar: type):
    """Compose the struct of the cells of a lattice."""
    CellTable: Any = cell_table(scalar)

    @wp.struct
    class LatticeCells:
        steps: wp.vec3i  # index steps from a particle to its neighbour along each axis
        table: CellTable  # constants of each cell
        lower: wp.array(dtype=int)  # first corner of each cell, shape [cell_count]
        margin: int  # entries of `pressure` before the first and after the last particle
        pressure: wp.array(dtype=scalar)  # [Pa], at a cell's first corner; 0 if there is no cell; for all worlds

    return LatticeCells


@functools.cache
def lattice_pressure(scalar: type, compensated: bool, damped: bool):
    """Compose wp.func (cells, compensation, x, v, shift, c, first) that writes the pressure of cell c.

    Particles of the cell's world begin at index `shift`, and the world's entries of `pressure` at `first`.
    """
    _V, Vectors, Compensation = state_types(3, scalar, compensated)
    Cells: Any = lattice_cells(scalar)
    Rows, geometry, _turning = cell_geometry(3, scalar, True, False)
    pressure_of, load = cell_pressure(scalar, damped), records(3, scalar).load
    separation = difference(3, scalar, compensated)

    @wp.func
    def corner_of(lower: int, steps: wp.vec3i, k: int) -> int:
        """Return the particle at corner k, in VTK's order."""
        corner = lower
        if k == 1 or k == 2 or k == 5 or k == 6:
            corner += steps[0]
        if k == 2 or k == 3 or k == 6 or k == 7:
            corner += steps[1]
        if k > 3:
            corner += steps[2]
        return corner

    @wp.func
    def find_pressure(
        cells: Cells, compensation: Compensation, x: Vectors, v: Vectors, shift: int, c: int, first: int
    ):
        lower = cells.lower[c]
        origin = shift + lower
        points = Rows()
        for k in range(8):
            i = corner_of(origin, cells.steps, k)
            points[k] = separation(compensation, x, load(x, i), i, origin)
        volume, gradient = geometry(points, False)
        rate = scalar(0.0)
        if wp.static(damped):
            for k in range(8):
                rate += wp.dot(load(v, corner_of(origin, cells.steps, k)), gradient[k])
        cells.pressure[first + cells.margin + lower] = pressure_of(cells.table, c, volume, rate)

    return find_pressure


@functools.cache
def lattice_volumes(scalar: type, compensated: bool, damped: bool, everywhere: bool) -> ForceTerm:
    """Return the term of a lattice's cells; before forces each cell writes its pressure, which particles read.

    If cells are `everywhere`, the kernel does not test whether a particle has cells.
    """
    V, Vectors, Compensation = state_types(3, scalar, compensated)
    Cells: Any = lattice_cells(scalar)
    load, separation = records(3, scalar).load, difference(3, scalar, compensated)
    find_pressure, Instant = lattice_pressure(scalar, compensated, damped), instant(3, scalar, compensated)
    Six = wp.types.matrix((6, 3), scalar)
    zero = scalar(0.0)

    @wp.func
    def sum_over_faces(data: Cells, now: Instant, i: int) -> V:
        steps = data.steps
        last = now.inverse_mass.shape[0] - 1
        at = data.margin + i
        near = Six()  # entries of missing neighbours are not used by any face
        for k in range(6):
            j = wp.clamp(i + (1 - 2 * (k % 2)) * steps[k / 2], 0, last)
            near[k] = separation(now.compensation, now.x, load(now.x, j), j, i)
        total = V()
        for axis in range(3):
            u = steps[axis]
            w = steps[(axis + 1) % 3]
            across = steps[(axis + 2) % 3]
            for k in range(4):
                below = at - across
                if k % 2 == 1:
                    below -= u
                if k / 2 == 1:
                    below -= w
                jump = data.pressure[below + across] - data.pressure[below]
                if jump != zero:
                    a = near[2 * axis + k % 2]
                    b = near[2 * ((axis + 1) % 3) + k / 2]
                    j = i + (1 - 2 * (k % 2)) * u + (1 - 2 * (k / 2)) * w
                    corner = separation(now.compensation, now.x, load(now.x, j), j, i)
                    if k == 1 or k == 2:  # clockwise corners
                        jump = -jump
                    total += jump * (wp.cross(a, corner + b) + wp.cross(corner, b))
        return total / scalar(12.0)

    @wp.func
    def cell_count(data: Cells) -> int:
        return data.lower.shape[0]

    @wp.func
    def find_own_pressure(data: Cells, compensation: Compensation, x: Vectors, v: Vectors, c: int):
        find_pressure(data, compensation, x, v, 0, c, 0)

    before = cell_count, find_own_pressure
    return ForceTerm("cells", Cells, force=sum_over_faces, before_forces=before, selective=not everywhere)


@functools.cache
def lattice_pressures(scalar: type, compensated: bool, damped: bool):
    """Compose the kernel, over worlds and cells, of the pressures in a lattice's cells."""
    _V, Vectors, Compensation = state_types(3, scalar, compensated)
    Cells: Any = lattice_cells(scalar)
    find_pressure = lattice_pressure(scalar, compensated, damped)

    @kernel
    def find_pressures(
        # Model, and pressures out:
        cells: Cells,
        begin: int,  # first cell of this launch
        stride: int,  # particles from one world to the next
        size: int,  # entries of `pressure` from one world to the next
        # State in:
        compensation: Compensation,
        x: Vectors,  # [m], of all worlds
        v: Vectors,  # [m/s]
    ):
        world, c = wp.tid()
        find_pressure(cells, compensation, x, v, world * stride, begin + c, world * size)

    return find_pressures
