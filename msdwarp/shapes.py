"""Shapes: bodies whose particles lie on a regular lattice, centred at the origin."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks
from .system import Surface, System


def lattice_directions(dim: int, *, diagonals: bool) -> dict[str, tuple[int, ...]]:
    """Return the steps from a lattice point to half of its neighbours, by name.

    Axes come first, then face diagonals, then space diagonals: by length, as in the report. Without
    `diagonals` there are `dim` of them, with them (3^dim − 1)/2. The name of (1, −1, 0) is "x-y".
    """
    steps = [step for step in itertools.product((1, 0, -1), repeat=dim) if step > (0,) * dim]
    steps.sort(key=lambda step: (sum(map(abs, step)), tuple(-s for s in step)))
    named = {}
    for step in steps[: None if diagonals else dim]:
        parts = (("+" if s > 0 else "-") + axis for axis, s in zip("xyz", step, strict=False) if s)
        named["".join(parts).removeprefix("+")] = step
    return named


def lattice_connections(
    shape: Sequence[int], directions: dict[str, tuple[int, ...]]
) -> tuple[NDArray[np.int32], dict[str, slice]]:
    """Join every lattice point with its neighbour in each direction, direction after direction.

    Returns the connections, shape [connection_count, 2], and the slice of each direction.
    """
    index = np.arange(np.prod(shape), dtype=np.int32).reshape(shape[::-1])  # z, y, x
    ends = {}
    for name, step in directions.items():
        here = tuple(slice(max(0, -s), min(n, n - s)) for s, n in zip(step, shape, strict=True))
        there = tuple(slice(max(0, s), min(n, n + s)) for s, n in zip(step, shape, strict=True))
        ends[name] = index[here[::-1]], index[there[::-1]]
    connections = np.empty((sum(first.size for first, _ in ends.values()), 2), dtype=np.int32)
    slices, start = {}, 0
    for name, (first, second) in ends.items():
        slices[name] = slice(start, start + first.size)
        start += first.size
        pairs = connections[slices[name]].reshape(*first.shape, 2)  # a view: written where it belongs
        pairs[..., 0], pairs[..., 1] = first, second
    return connections, slices


def _lattice(
    shape: Sequence[int],
    spacing: float,
    diagonals: bool,
    dim: int,
    surface: Surface | None,
    mass: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
) -> System:
    """Return the lattice of `shape` points, x fastest, in a space of `dim` coordinates."""
    spacing = checks.positive("spacing", spacing)
    axes = [spacing * (np.arange(n) - (n - 1) / 2) for n in shape]
    position = np.zeros((*shape[::-1], dim))  # z, y, x
    for k, coordinates in enumerate(np.meshgrid(*axes[::-1], indexing="ij", sparse=True)[::-1]):
        position[..., k] = coordinates
    position = position.reshape(-1, dim)
    directions = lattice_directions(len(shape), diagonals=diagonals)
    connections, slices = lattice_connections(shape, directions)
    rest_length = np.empty(len(connections))
    for name, step in directions.items():
        rest_length[slices[name]] = spacing * np.sqrt(sum(map(abs, step)))  # exactly 1, √2 or √3 spacings
    # What is made here is valid, but for a spacing so large that it overflows.
    for name, values in {"position": position, "rest_length": rest_length}.items():
        checks.within(name, values, (np.isfinite, "finite"))
    lattice = System._of_own(
        position=position,
        connections=connections,
        rest_length=rest_length,
        surface=surface,
        directions=(slices,),
    )
    return lattice.replace(mass=mass, stiffness=stiffness, damping=damping)


def _check_shape(shape: Sequence[int], axes: int) -> None:
    """Check the number of particles along each axis."""
    if not isinstance(shape, Sequence) or len(shape) != axes:
        raise ValueError(f"shape is {shape!r}; it must be {axes} numbers of particles")
    for k, n in enumerate(shape):
        checks.count(f"shape[{k}]", n, 2)


def chain(
    count: int,
    spacing: float = 1.0,
    *,
    mass: ArrayLike = 1.0,
    stiffness: ArrayLike = 1000.0,
    damping: ArrayLike = 0.0,
    dim: int = 3,
) -> System:
    """Return `count` particles in a row along x, each joined with the next.

    Parameters
    ----------
    count
        Number of particles, at least 2.
    spacing
        Distance of neighbours and rest length [m].
    mass, stiffness, damping
        Of each particle [kg] and each connection [N/m], [N s/m]; see `System`.
    dim
        Number of coordinates: 1, 2 or 3.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    checks.one_of("dim", dim, (1, 2, 3))
    count = checks.count("count", count, 2)
    return _lattice((count,), spacing, False, dim, None, mass, stiffness, damping)


def sheet(
    shape: tuple[int, int],
    spacing: float = 1.0,
    *,
    neighbours: int = 8,
    mass: ArrayLike = 1.0,
    stiffness: ArrayLike = 1000.0,
    damping: ArrayLike = 0.0,
    dim: int = 3,
) -> System:
    """Return a rectangular sheet of particles in the x-y plane.

    Parameters
    ----------
    shape
        Number of particles along x and y, each at least 2.
    spacing
        Distance of neighbours along an axis [m].
    neighbours
        4 joins neighbours along the axes (such a sheet collapses by shearing: report fig. 7); 8 adds the
        diagonals (fig. 8).
    mass, stiffness, damping
        Of each particle [kg] and each connection [N/m], [N s/m]; see `System`.
    dim
        Number of coordinates: 2 or 3.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    checks.one_of("dim", dim, (2, 3))
    checks.one_of("neighbours", neighbours, (4, 8))
    _check_shape(shape, 2)
    index = np.arange(np.prod(shape)).reshape(shape[::-1])
    particle, uv, triangles = _grid_face(index.T)
    surface = Surface(particle=particle, uv=uv, triangles=triangles)
    return _lattice(shape, spacing, neighbours == 8, dim, surface, mass, stiffness, damping)


def box(
    shape: tuple[int, int, int],
    spacing: float = 1.0,
    *,
    neighbours: int = 26,
    mass: ArrayLike = 1.0,
    stiffness: ArrayLike = 1000.0,
    damping: ArrayLike = 0.0,
) -> System:
    """Return a solid block of particles.

    Its surface has the six faces side by side in one texture, three columns of two rows:
    −x, +x, −y in the lower row and +y, −z, +z in the upper one.

    Parameters
    ----------
    shape
        Number of particles along x, y and z, each at least 2.
    spacing
        Distance of neighbours along an axis [m].
    neighbours
        6 joins neighbours along the axes (such a block collapses by shearing); 26 adds the diagonals
        of faces and cells.
    mass, stiffness, damping
        Of each particle [kg] and each connection [N/m], [N s/m]; see `System`.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    checks.one_of("neighbours", neighbours, (6, 26))
    _check_shape(shape, 3)
    return _lattice(shape, spacing, neighbours == 26, 3, _box_surface(shape), mass, stiffness, damping)


def _grid_face(index: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return (particle, uv, triangles) of a grid of particles [a, b], facing a × b."""
    a, b = index.shape
    vertex = np.arange(a * b).reshape(a, b)
    corner, along_a, along_b, across = vertex[:-1, :-1], vertex[1:, :-1], vertex[:-1, 1:], vertex[1:, 1:]
    triangles = np.concatenate(
        [
            np.stack([corner, along_a, across], axis=-1).reshape(-1, 3),
            np.stack([corner, across, along_b], axis=-1).reshape(-1, 3),
        ]
    )
    u, v = np.meshgrid(np.linspace(0, 1, a), np.linspace(0, 1, b), indexing="ij")
    return index.ravel(), np.stack([u.ravel(), v.ravel()], axis=1), triangles


def _box_surface(shape: tuple[int, int, int]) -> Surface:
    """Return the six faces of a box, facing outwards, each in its tile of the texture."""
    index = np.arange(np.prod(shape)).reshape(shape[::-1]).transpose(2, 1, 0)  # x, y, z
    faces = (
        index[0].T,  # −x: spanned by z × y
        index[-1],  # +x: y × z
        index[:, 0],  # −y: x × z
        index[:, -1].T,  # +y: z × x
        index[:, :, 0].T,  # −z: y × x
        index[:, :, -1],  # +z: x × y
    )
    particles, uvs, triangles, vertices = [], [], [], 0
    for k, face in enumerate(faces):
        particle, uv, triangle = _grid_face(face)
        particles.append(particle)
        uvs.append((uv + np.array([k % 3, k // 3])) / (3, 2))
        triangles.append(triangle + vertices)
        vertices += len(particle)
    return Surface(particle=np.concatenate(particles), uv=np.concatenate(uvs), triangles=np.concatenate(triangles))
