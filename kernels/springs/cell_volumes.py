"""Cells that resist a change of volume: pressures, and forces on the corners.

A cell of volume V stores W = V₀ w(J), J = V/V₀, and exerts on its corner c the force −p ∂V/∂x_c with

    p = w'(J) + c V̇/V₀

The faces of solid cells are bilinear; ∂V/∂x_c follows from the six corners around c. Reference: Flanagan and
Belytschko, A uniform strain hexahedron and quadrilateral with orthogonal hourglass control, Int. J. Numer. Methods
Eng. 17 (1981) 679-706. Flat cells have the area |d₁ × d₂|/2 of their diagonals.

With d = J − 1, a modulus κ ≥ 0 has w' = κ d, and below J₀ = CRUSHED w' = κ (d − STIFFENING (J₀ − J)²), so that a
crushed cell does not turn inside out: springs do not resist that, as a mirrored cell strains none. With a negative
modulus w' = κ d would let a body collapse. So there w' = 2 κ d/(1 + J²) for d ≥ 0 and κ d/(1 + d²) for d < 0: both
are κ d near J = 1; far from it springs dominate. The damping is c w''/κ, and 0 where w''/κ is negative.
"""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import state_types
from ..effect import ElementForce, ForceTerm, instant
from ..records import records
from .cell_geometry import cell_geometry
from .force_algorithm import difference

CRUSHED, STIFFENING = 1.0 / 3.0, 30.0
"""J₀, the fraction of its volume below which a cell stiffens, and by how much: 21-fold at J = 0."""


@functools.cache
def volume_law(scalar: type):
    """Compose law(κ, J) -> (w, w', w'', fraction of damping), see the module's docstring."""

    @wp.func
    def law(modulus: scalar, ratio: scalar):
        one = scalar(1.0)
        d = ratio - one
        energy = scalar(0.5) * d * d
        slope = d
        curvature = one
        if modulus < scalar(0.0):
            if d < scalar(0.0):
                s = one + d * d
                energy = scalar(0.5) * wp.log(s)
                slope = d / s
                curvature = (one - d * d) / (s * s)
            else:
                s = one + ratio * ratio
                energy = wp.log(scalar(0.5) * s) + scalar(2.0) * (wp.atan(one) - wp.atan(ratio))
                slope = scalar(2.0) * d / s
                curvature = scalar(2.0) * (one + scalar(2.0) * ratio - ratio * ratio) / (s * s)
        else:
            crushed = wp.max(scalar(CRUSHED) - ratio, scalar(0.0))
            energy += scalar(STIFFENING) / scalar(3.0) * crushed * crushed * crushed
            slope -= scalar(STIFFENING) * crushed * crushed
            curvature += scalar(2.0) * scalar(STIFFENING) * crushed
        return modulus * energy, modulus * slope, modulus * curvature, wp.max(curvature, scalar(0.0))

    return law


@functools.cache
def cell_table(scalar: type):
    """Compose the struct of the cells of a model."""

    @wp.struct
    class CellTable:
        corners: wp.array2d(dtype=int)  # particles, shape [cell_count, 8]; -1 in the last four of flat cells
        rest_volume: wp.array(dtype=scalar)  # V0 [m³], or [m²], shape [cell_count]
        modulus: wp.array(dtype=scalar)  # [Pa], or [N/m], shape [cell_count]
        damping: wp.array(dtype=scalar)  # [Pa s], or [N s/m], shape [cell_count]

    return CellTable


@functools.cache
def cell_pressure(scalar: type, damped: bool):
    """Compose wp.func (cells, c, volume, rate) -> pressure in cell c [Pa]; `rate` is dV/dt [m³/s]."""
    CellTable: Any = cell_table(scalar)
    law = volume_law(scalar)

    @wp.func
    def pressure_of(cells: CellTable, c: int, volume: scalar, rate: scalar) -> scalar:
        rest = cells.rest_volume[c]
        _energy, pressure, _curvature, damping_fraction = law(cells.modulus[c], volume / rest)
        if wp.static(damped):
            pressure += cells.damping[c] * damping_fraction * rate / rest
        return pressure

    return pressure_of


@functools.cache
def cell_force(dim: int, scalar: type, compensated: bool, solid: bool, flat: bool, damped: bool):
    """Compose wp.func (cells, compensation, x, v, shift, c, force, first): write cell c's forces on its corners.

    The particles of the cell's world begin at `shift`. Corner k's force is written at first + k · cell_count [N].
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    CellTable: Any = cell_table(scalar)
    Rows, geometry, _turning = cell_geometry(dim, scalar, solid, flat)
    pressure_of, corners = cell_pressure(scalar, damped), 8 if solid else 4
    load, separation = records(dim, scalar).load, difference(dim, scalar, compensated)

    @wp.func
    def exert(
        cells: CellTable,
        compensation: Compensation,
        x: Vectors,
        v: Vectors,
        shift: int,
        c: int,
        force: wp.array(dtype=V),
        first: int,
    ):
        used = wp.static(corners)
        is_flat = wp.static(not solid)
        if wp.static(solid and flat):
            is_flat = cells.corners[c, 7] < 0
            if is_flat:
                used = 4
        origin = shift + cells.corners[c, 0]
        points = Rows()
        for k in range(wp.static(corners)):
            if k < used:
                i = shift + cells.corners[c, k]
                points[k] = separation(compensation, x, load(x, i), i, origin)
        volume, gradient = geometry(points, is_flat)
        rate = scalar(0.0)
        if wp.static(damped):
            for k in range(wp.static(corners)):
                if k < used:
                    rate += wp.dot(load(v, shift + cells.corners[c, k]), gradient[k])
        pressure = pressure_of(cells, c, volume, rate)
        for k in range(wp.static(corners)):
            force[first + k * cells.corners.shape[0]] = -pressure * gradient[k]

    return exert


@functools.cache
def cell_volumes(
    dim: int, scalar: type, compensated: bool, solid: bool, flat: bool, damped: bool, everywhere: bool
) -> ForceTerm:
    """Return the term of cells; before forces each cell writes its own on its corners, which particles sum.

    If cells are `everywhere`, the kernel does not test whether a particle has cells.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    CellTable: Any = cell_table(scalar)
    exert, Instant = cell_force(dim, scalar, compensated, solid, flat, damped), instant(dim, scalar, compensated)

    @wp.struct
    class Corners:
        cells: CellTable
        first: wp.array(dtype=int)  # row starts of `entry`, shape [particle_count + 1]
        entry: wp.array(dtype=int)  # entries of `force` on each particle, shape [any]
        force: wp.array(dtype=V)  # on corner k of cell c at k · cell_count + c [N], for all worlds

    @wp.func
    def sum_over_corners(data: Corners, now: Instant, i: int) -> V:
        total = V()
        for e in range(data.first[i], data.first[i + 1]):
            total += data.force[data.entry[e]]
        return total

    @wp.func
    def cell_count(data: Corners) -> int:
        return data.cells.corners.shape[0]

    @wp.func
    def exert_on_corners(data: Corners, compensation: Compensation, x: Vectors, v: Vectors, c: int):
        exert(data.cells, compensation, x, v, 0, c, data.force, c)

    before = cell_count, exert_on_corners
    return ForceTerm("cells", Corners, force=sum_over_corners, before_forces=before, selective=not everywhere)


@functools.cache
def cell_forces(dim: int, scalar: type, compensated: bool, solid: bool, flat: bool, damped: bool):
    """Compose the kernel, over worlds and cells, of the forces on the corners of cells."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    CellTable: Any = cell_table(scalar)
    exert, corners = cell_force(dim, scalar, compensated, solid, flat, damped), 8 if solid else 4

    @kernel
    def find_cell_forces(
        # Model:
        cells: CellTable,
        begin: int,  # first cell of this launch
        stride: int,  # particles from one world to the next
        # State in:
        compensation: Compensation,
        x: Vectors,  # [m], of all worlds
        v: Vectors,  # [m/s]
        # Out:
        force: wp.array(dtype=V),  # [N], of all worlds, see `cell_volumes`
    ):
        world, c = wp.tid()
        c += begin
        first = world * wp.static(corners) * cells.corners.shape[0] + c
        exert(cells, compensation, x, v, world * stride, c, force, first)

    return find_cell_forces


@functools.cache
def cell_law(dim: int, scalar: type, solid: bool, flat: bool, damped: bool):
    """Compose the law of a cell: φ·F, for `adjoint.elements`."""
    CellTable: Any = cell_table(scalar)
    Rows, geometry, _turning = cell_geometry(dim, scalar, solid, flat)
    pressure_of, corners = cell_pressure(scalar, damped), 8 if solid else 4

    @wp.func
    def projected(cells: CellTable, c: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows) -> scalar:
        is_flat = cells.corners[c, wp.static(corners - 1)] < 0 or wp.static(not solid)
        points = Rows()
        for k in range(wp.static(corners)):
            points[k] = x[k] - x[0]
        volume, gradient = geometry(points, is_flat)
        rate = scalar(0.0)
        along = scalar(0.0)
        for k in range(wp.static(corners)):  # the gradient is 0 at the last four of a flat cell
            rate += wp.dot(v[k], gradient[k])
            along += wp.dot(phi[k], gradient[k])
        return -pressure_of(cells, c, volume, rate) * along

    return ElementForce(projected=projected, points=corners)


@functools.cache
def cell_energies(dim: int, scalar: type, solid: bool, flat: bool):
    """Compose the kernel, over worlds and cells, of the stored energy and dissipated power of each cell."""
    V, Row = vector(dim, scalar), vector(dim, wp.float64)
    CellTable: Any = cell_table(scalar)
    Rows, geometry, _turning = cell_geometry(dim, wp.float64, solid, flat)
    law, corners = volume_law(wp.float64), 8 if solid else 4

    @kernel
    def find_cell_energies(
        # Model:
        cells: CellTable,
        stride: int,  # particles from one world to the next
        # State in:
        x: wp.array(dtype=V),  # [m], of all worlds
        v: wp.array(dtype=V),  # [m/s]
        # Out, shape [worlds, cell_count]:
        energy: wp.array2d(dtype=wp.float64),  # [J]
        power: wp.array2d(dtype=wp.float64),  # [W]
    ):
        w, c = wp.tid()
        first = w * stride
        used = wp.static(corners)
        is_flat = cells.corners[c, 7] < 0
        if is_flat:
            used = 4
        points = Rows()
        for k in range(wp.static(corners)):
            if k < used:
                points[k] = Row(x[first + cells.corners[c, k]])
        volume, gradient = geometry(points, is_flat)
        rest = wp.float64(cells.rest_volume[c])
        density, _pressure, _curvature, damping_fraction = law(wp.float64(cells.modulus[c]), volume / rest)
        rate = wp.float64(0.0)
        for k in range(wp.static(corners)):
            if k < used:
                rate += wp.dot(Row(v[first + cells.corners[c, k]]), gradient[k])
        energy[w, c] = rest * density
        power[w, c] = wp.float64(cells.damping[c]) * damping_fraction * rate * rate / rest

    return find_cell_energies


@functools.cache
def cell_blocks(dim: int, scalar: type, solid: bool, flat: bool):
    """Compose the kernel that adds a bound of each cell's stiffness to the diagonal blocks of its corners.

    A cell adds w''/V₀ g gᵀ to K, with the gradient g of its volume, and w' ∂²V/∂x². With weights s_c that sum to
    1, (Σ g_c·u_c)² ≤ Σ (g_c·u_c)²/s_c: so g gᵀ is at most the blocks g_c g_cᵀ/s_c. Weights proportional to 1/m_c
    make this exact for a single cell. The second part is bounded by Gershgorin's row sums. Half of both is added,
    since the bound doubles blocks.
    """
    V, Row = vector(dim, scalar), vector(dim, wp.float64)
    Block = wp.types.matrix((dim, dim), wp.float64)
    CellTable: Any = cell_table(scalar)
    Rows, geometry, turning = cell_geometry(dim, wp.float64, solid, flat)
    law, corners = volume_law(wp.float64), 8 if solid else 4

    @kernel
    def add_cell_blocks(
        # Model:
        cells: CellTable,
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        # State in:
        x: wp.array(dtype=V),  # [m], shape [particle_count]
        # Out:
        stiffness: wp.array(dtype=Block),  # A_i [N/m], shape [particle_count]
        damping: wp.array(dtype=Block),  # B_i [N s/m], shape [particle_count]
    ):
        c = wp.tid()
        used = wp.static(corners)
        is_flat = cells.corners[c, 7] < 0
        if is_flat:
            used = 4
        points = Rows()
        light = wp.float64(0.0)
        for k in range(wp.static(corners)):
            if k < used:
                i = cells.corners[c, k]
                points[k] = Row(x[i])
                light += wp.float64(inverse_mass[i])
        if light == wp.float64(0.0):
            return
        volume, gradient = geometry(points, is_flat)
        rest = wp.float64(cells.rest_volume[c])
        _energy, pressure, curvature, damping_fraction = law(wp.float64(cells.modulus[c]), volume / rest)
        sums = turning(points, is_flat)
        for k in range(wp.static(corners)):
            if k < used:
                i = cells.corners[c, k]
                own = wp.float64(inverse_mass[i])
                if own > wp.float64(0.0):
                    square = wp.float64(0.5) / rest * light / own * wp.outer(gradient[k], gradient[k])
                    turned = wp.float64(0.5) * wp.abs(pressure) * sums[k]
                    along = wp.max(curvature, wp.float64(0.0)) * square
                    damped = wp.max(wp.float64(cells.damping[c]), wp.float64(0.0)) * damping_fraction
                    wp.atomic_add(stiffness, i, along + turned * wp.identity(dim, wp.float64))
                    wp.atomic_add(damping, i, damped * square)

    return add_cell_blocks


@functools.cache
def inverted_cells(dim: int, scalar: type):
    """Compose the kernel, over worlds and cells, that marks cells whose volume, or area, is not above 0."""
    V, Row = vector(dim, scalar), vector(dim, wp.float64)
    Rows, geometry, _turning = cell_geometry(dim, wp.float64, dim == 3, dim == 2)

    @kernel
    def mark_inverted(
        corners: wp.array2d(dtype=int),  # shape [cell_count, 8], or 4 in two dimensions
        stride: int,  # particles from one world to the next
        x: wp.array(dtype=V),  # [m], of all worlds
        inverted: wp.array2d(dtype=wp.uint8),  # out, shape [worlds, cell_count]
    ):
        w, c = wp.tid()
        points = Rows()
        for k in range(wp.static(4 * dim - 4)):
            points[k] = Row(x[w * stride + corners[c, k]])
        volume, _gradient = geometry(points, wp.static(dim == 2))
        inverted[w, c] = wp.uint8(volume <= wp.float64(0.0))

    return mark_inverted
