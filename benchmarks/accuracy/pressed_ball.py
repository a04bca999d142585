"""The force that a ball bears between two plates, beside Hertz's law and finite elements.

    python -m benchmarks.accuracy.pressed_ball [--device D] [--quick] [--plot-only]

pressed_ball.csv has a row for each ball and distance of the plates, which have no friction:

- `across`, `divisions`: cells across the ball, and how often the triangles of its surface were divided into four.
- `depth`: the way of each plate over the radius; `force` of a plate [N], and `hertz`, over that by Hertz's law.
- `elements`: the force by finite elements in linear elasticity over that by Hertz's law, which is for a ball that
  is large beside its areas of contact; `ratio`: `hertz` over it.
"""

import math

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from msdwarp import Contact, Material, Plane, Simulation, from_mesh, icosphere

from ..common import arguments, machine, read_csv, table, write_csv

RADIUS, MODULUS, RATIO = 0.2, 1e5, 0.45
"""Radius [m], Young's modulus [Pa] and Poisson's ratio."""
DEPTHS = (0.025, 0.05, 0.075, 0.125)
BALLS = ((8, 3), (12, 3), (8, 4), (12, 4), (16, 4))
"""Cells across, and how often the triangles of the surface are divided into four."""
GRADING = 1.8
"""Exponent by which elements are finer near the surface and the axis."""


def hertz(depth: float) -> float:
    """Return the force [N] if each plate presses the ball in by depth · radius (Hertz 1882)."""
    return 4 / 3 * MODULUS / (1 - RATIO**2) * RADIUS**2 * depth**1.5


def measure(across: int, divisions: int, device: str) -> dict[float, float]:
    """Return the force of the upper plate [N] by depth."""
    rubber = Material(density=1000.0, youngs_modulus=MODULUS, poissons_ratio=RATIO, damping_ratio=0.1)
    ball = from_mesh(icosphere(RADIUS, divisions), across=across, material=rubber)
    how = {"gravity": 0.0, "contact": Contact(surface_colliders=True), "contact_forces": True, "fps": 2000}
    simulation, forces = Simulation(ball, device=device, **how), {}
    for depth in DEPTHS:
        offset = (depth - 1) * RADIUS
        simulation.change(colliders=[Plane((0, 0, z), offset, friction=0.0) for z in (-1, 1)])
        simulation.settle()
        simulation.step()
        forces[depth] = -float(simulation.contact_force()[ball.position[:, 2] > 0, 2].sum())
    return forces


def by_elements(depths: tuple[float, ...], count: int) -> dict[float, float]:
    """Return the force on a linearly elastic ball over Hertz's by depth, with count × count biquadratic elements.

    A quarter of the section (r, z) is meshed; the equator keeps its height, and the plate pushes each node that is
    beyond it back onto it, but pulls at none (Zienkiewicz and Taylor, The Finite Element Method: axial symmetry).
    """
    n = 2 * count + 1
    far = np.linspace(0.0, 1.0, n)
    radius, angle = 1 - (1 - far) ** GRADING, math.pi / 2 * far**GRADING  # from the axis
    r, z = np.outer(radius, np.sin(angle)).ravel(), np.outer(radius, np.cos(angle)).ravel()
    nodes = np.arange(n * n).reshape(n, n)
    nodes[0] = 0  # the centre is one node
    elements = np.array(
        [nodes[i : i + 3, j : j + 3].ravel() for i in range(0, n - 1, 2) for j in range(0, n - 1, 2)]
    )
    stiffness = stiffness_matrix(elements, r, z, n * n)
    axis, equator, surface = nodes[:, 0], nodes[:, -1], nodes[-1]
    unused = np.setdiff1d(np.arange(n * n), nodes)
    held = np.unique(np.concatenate([2 * axis, 2 * equator + 1, 2 * unused, 2 * unused + 1]))
    found = {}
    for depth in depths:
        touching = z[surface] > 1 - depth
        while True:
            pushed = 2 * surface[touching] + 1
            fixed = np.union1d(held, pushed)
            free = np.setdiff1d(np.arange(2 * n * n), fixed)
            u = np.zeros(2 * n * n)
            u[pushed] = 1 - depth - z[surface[touching]]
            u[free] = spsolve(stiffness[free][:, free].tocsc(), -(stiffness[free] @ u))
            force = stiffness @ u
            height = z[surface] + u[2 * surface + 1]
            then = np.where(touching, force[2 * surface + 1] < 0, height > 1 - depth + 1e-12)
            if (then == touching).all():
                break
            touching = then
        found[depth] = float(-force[pushed].sum()) * (1 - RATIO**2) * 3 / 4 / depth**1.5
    return found


def stiffness_matrix(elements: NDArray, r: NDArray, z: NDArray, count: int) -> sparse.csr_matrix:
    """Return the stiffness matrix of a body of revolution with Young's modulus 1, by 3 × 3 Gauss points."""
    shear = 1 / (2 * (1 + RATIO))
    law = np.diag([2 * shear, 2 * shear, 2 * shear, shear])
    law[:3, :3] += RATIO / ((1 + RATIO) * (1 - 2 * RATIO))
    matrices = np.zeros((len(elements), 18, 18))
    points = np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)]), np.array([5.0, 8.0, 5.0]) / 9
    for a, weight in zip(*points, strict=True):
        for b, other in zip(*points, strict=True):
            (line_a, slope_a), (line_b, slope_b) = quadratic(a), quadratic(b)
            shape = np.outer(line_a, line_b).ravel()
            along = np.outer(slope_a, line_b).ravel(), np.outer(line_a, slope_b).ravel()
            (ra, rb), (za, zb) = ([x[elements] @ one for one in along] for x in (r, z))
            jacobian, radius = ra * zb - rb * za, r[elements] @ shape
            by_r = (np.outer(zb, along[0]) - np.outer(za, along[1])) / jacobian[:, None]
            by_z = (np.outer(ra, along[1]) - np.outer(rb, along[0])) / jacobian[:, None]
            strain = np.zeros((len(elements), 4, 18))  # along r, z and the circumference, and of shear
            strain[:, 0, 0::2], strain[:, 1, 1::2], strain[:, 3, 0::2], strain[:, 3, 1::2] = by_r, by_z, by_z, by_r
            strain[:, 2, 0::2] = shape / radius[:, None]
            volume = 2 * math.pi * np.abs(jacobian) * radius * weight * other
            matrices += np.einsum("eia,ij,ejb,e->eab", strain, law, strain, volume, optimize=True)
    unknowns = np.stack([2 * elements, 2 * elements + 1], axis=-1).reshape(len(elements), 18)
    rows, columns = np.repeat(unknowns, 18, axis=1).ravel(), np.tile(unknowns, (1, 18)).ravel()
    return sparse.csr_matrix((matrices.ravel(), (rows, columns)), shape=(2 * count, 2 * count))


def quadratic(s: float) -> tuple[NDArray, NDArray]:
    """Return the three quadratic shape functions on −1 … 1, and their slopes."""
    return np.array([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2]), np.array([s - 0.5, -2 * s, s + 0.5])


def main() -> None:
    """Measure, write and print."""
    options = arguments("How much force does a ball bear between two plates?")
    path = options.folder / "pressed_ball.csv"
    if not options.plot_only:
        elements, rows = by_elements(DEPTHS, 16 if options.quick else 32), []
        for across, divisions in BALLS[: 1 if options.quick else None]:
            for depth, force in measure(across, divisions, options.device).items():
                over = force / hertz(depth)
                row = {"across": across, "divisions": divisions, "depth": depth, "force": force, "hertz": over}
                rows.append(row | {"elements": elements[depth], "ratio": over / elements[depth]})
                print(rows[-1], flush=True)
        write_csv(path, rows, machine(options.device))
    _, rows = read_csv(path)
    table(path.name, list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    main()
