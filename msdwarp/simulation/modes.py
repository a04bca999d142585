"""Modes: eigenfrequencies, shapes and damping ratios of small vibrations about a state at rest."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from ..engine import State, Tangent, assemble, outward_normals, start_depths, touching
from ..runtime import in_turn
from ..world import Problem, Scene
from .arguments import problem_of
from .settling import held_at, settled
from .simulation import Simulation

SHIFT = 1e-8
"""Shift of the matrix that is inverted, as a share of a bound of its eigenvalues: K itself has no inverse where
nothing holds a body."""
ROUNDING = 1e-14
"""Share of that bound up to which an eigenvalue is 0."""
PRESSES = 1e-3
"""Share of the strongest force on an obstacle above which it holds a particle; settling leaves such forces."""
ASYMMETRY = 1e-9
"""Largest difference of K from its transpose, as a share of its largest entry."""


class Modes(NamedTuple):
    """Small vibrations about a state at rest, the slowest first.

    Attributes
    ----------
    frequencies
        Eigenfrequencies ω/2π [Hz], shape [count]. 0 for rigid motions and mechanisms. A negative one says that the
        state is unstable: the motion grows as exp(2π |f| t).
    position
        Positions at rest [m], shape [particle_count, d].
    shapes
        Displacements φ of all particles, shape [count, particle_count, d]; the largest displacement is 1.
    damping_ratios
        ζ = φᵀBφ / (2 ω φᵀMφ), shape [count]: 1 is critical; NaN where the frequency is not above 0.
    masses
        Modal masses φᵀMφ [kg], shape [count]: with amplitude a [m], a mode has the energy φᵀMφ ω² a²/2.
    """

    frequencies: NDArray[np.float64]
    position: NDArray[np.float64]
    shapes: NDArray[np.float64]
    damping_ratios: NDArray[np.float64]
    masses: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"<{len(self.masses)} modes: {', '.join(f'{one:.4g}' for one in self.frequencies)} Hz>"


@in_turn
def modes(system: System | Scene | Simulation, count: int = 10) -> Modes:
    """Return the slowest small vibrations of bodies about the state in which they are at rest.

    They solve K φ = ω² M φ. K = −∂F/∂x are the derivatives of all forces in that state, by the laws of the
    simulation: of springs with their tension, angles, cells, gases, attachments, other loads, and obstacles with a
    stiffness. So tension raises frequencies, and weight changes them if the scene is settled; constant forces and
    gravity themselves have no derivative. Pinned and driven particles stay where they are. So do particles that
    press on an obstacle without a stiffness, and without friction they slide on it. Nothing breaks or yields.

    Damping ratios are those of the diagonal of the modal damping matrix, with B = −∂F/∂v at rest: exact if K and
    B have the same modes, else good if damping is small (Clough & Penzien, *Dynamics of Structures*, chapter 12).
    A straight rod has no plane of bending, in which its dampers act: bending has the ratio 0 then.

    A body that nothing holds has six rigid motions of frequency 0 (three in a plane, one on a line); they count.
    Other modes of frequency 0 are mechanisms, such as sideways motions of a rope without tension. After settling,
    the forces that are left can give such a mode a small frequency of either sign. SciPy's `eigsh` finds the modes
    by the inverse of a shifted K (Ericsson & Ruhe, Math. Comp. 35, 1980); of a solid of 20³ particles in 15 s.

    Parameters
    ----------
    system
        A system or a scene as it starts, after settling if it is `settled`; or a simulation as it is now, such as
        after `settle`. Velocities do not count. A simulation in float32 has rounded positions, which change the
        slowest frequencies of slender bodies: use float64, or give a scene.
    count
        Number of modes: those with the least |ω|; all, if there are fewer.

    Raises
    ------
    ValueError
        If an argument is out of range, SciPy is not installed, bodies touch each other, a force has no derivative,
        or K is not symmetric. It is not if forces are not those of an energy, as of wind, or of a pressure on a
        surface with a free edge.

    Warns
    -----
    SettleWarning
        If a settled scene has not come to rest.
    """
    checks.count("count", count, 1)
    checks.imported("scipy.sparse.linalg", "modes need SciPy: pip install 'msdwarp[fit]'")
    from scipy.sparse import diags_array

    problem, time = _problem_at_rest(system)
    soft = tuple(one for one in problem.colliders if one.stiffness is not None)
    assembly = assemble(problem.with_checked(colliders=soft), device="cpu", precision="float64")
    at_rest = problem.system.replace(velocity=np.zeros_like(problem.system.velocity))
    tangent = Tangent(assembly, State.from_system(at_rest, assembly.model), time)
    ways = _free_ways(problem, tangent, time)
    if not (count := min(count, ways.shape[1])):
        raise ValueError("the system has no particle that can move; some must be neither pinned nor driven")
    mass = np.repeat(np.where(np.isfinite(assembly.model.mass), assembly.model.mass, 0.0), assembly.model.dim)
    ways = ways @ diags_array(1 / np.sqrt(ways.T.power(2) @ mass))  # now of unit mass
    stiffness, damping = (ways.T @ matrix @ ways for matrix in tangent.matrices())
    if abs(stiffness - stiffness.T).max() > ASYMMETRY * abs(stiffness).max():
        raise ValueError(
            "the stiffness matrix is not symmetric, as forces are not those of an energy; loads such as wind, "
            "pressure on a surface with a free edge, or a function of one's own must be left out"
        )
    squares, vectors = _eigenpairs((stiffness + stiffness.T) / 2, count)
    omega = np.sign(squares) * np.sqrt(np.abs(squares))
    resisted = np.einsum("ik,ik->k", vectors, damping @ vectors)
    ratios = np.divide(resisted, 2 * omega, out=np.full(count, np.nan), where=omega > 0)
    shapes = (ways @ vectors).T.reshape(count, *at_rest.position.shape)
    most = np.linalg.norm(shapes, axis=2).max(axis=1)
    flat = shapes.reshape(count, -1)
    sign = np.sign(flat[np.arange(count), np.abs(flat).argmax(axis=1)])
    shapes *= (sign / most)[:, None, None]
    return Modes(omega / (2 * np.pi), at_rest.position, shapes, ratios, 1 / most**2)


def _problem_at_rest(system: System | Scene | Simulation) -> tuple[Problem, float]:
    """Return what is at rest, where nothing breaks or yields, and its time [s]."""
    time = 0.0
    if isinstance(system, Simulation):
        problem, time = system.problem.with_checked(system=system.snapshot()), system.time
    else:
        problem = problem_of("system", system).begun()
        if isinstance(problem, Scene) and problem.settled:
            problem, found, _ = settled(problem, partial(assemble, device="cpu"))
            if not found.converged:
                checks.warn(str(found), checks.SettleWarning)
    if problem.contact_rules:
        contact = assemble(problem, device="cpu", precision="float64").body_contact
        if contact is not None and contact.touches:
            raise ValueError(
                "bodies touch each other, and contact between bodies has no modes: it is not linear; they must be "
                "apart, joined (msdwarp.join), or without contact"
            )
    body = problem.system
    whole: dict[str, Any] = dict.fromkeys(("yield_strain", "break_strain", "break_force", "broken_at"), np.inf)
    for name in ("stiffness", "damping") if body.broken.any() else ():
        whole[name] = np.where(body.broken, 0.0, getattr(body, name))
    body = body.replace(**whole) if body.tears or body.yields else body
    loads = tuple(one for one in problem.loads if one not in problem.contact_rules)
    return problem.with_checked(system=body, loads=loads, contact=None, probes={}), time


def _free_ways(problem: Problem, tangent: Tangent, time: float) -> Any:
    """Return independent directions of free motion as columns of a sparse matrix of particle_count d rows."""
    from scipy.linalg import null_space
    from scipy.sparse import block_diag, csr_array

    model, x = tangent.model, tangent.model.system.position
    stopped: list[list[Any]] = [[np.eye(model.dim)] if held else [] for held in np.isinf(model.mass)]
    for k, collider in enumerate(problem.rigid_colliders):
        solid = held_at(f"colliders[{k}]", collider, time)
        near = np.flatnonzero(np.isfinite(model.mass) & (start_depths(x, [solid])[0] > -touching(model.system)))
        if not len(near):
            continue
        normals = outward_normals(x[near], solid)
        pressing = -np.einsum("ik,ik->i", tangent.forces()[near], normals)
        for i in np.flatnonzero(pressing > PRESSES * max(pressing.max(), 0.0)):
            stopped[near[i]].append(np.eye(model.dim) if solid.friction > 0 else normals[i, None])
    free = np.eye(model.dim)
    return csr_array(block_diag([null_space(np.concatenate(one)) if one else free for one in stopped]))


def _eigenpairs(matrix: Any, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the eigenvalues nearest to 0 of a symmetric sparse matrix, in order, and their eigenvectors."""
    from scipy.linalg import eigh
    from scipy.sparse.linalg import eigsh

    size, bound = matrix.shape[0], float(abs(matrix).sum(axis=1).max()) or 1.0
    if 2 * count >= size:  # eigsh needs more room than that
        _, vectors = eigh(matrix.toarray())
    else:
        start = np.random.default_rng(0).normal(size=size)  # the same modes in each call
        _, vectors = eigsh(matrix.tocsc(), count, sigma=-SHIFT * bound, v0=start)
    squares = np.einsum("ik,ik->k", vectors, matrix @ vectors)  # rounded less than those of the inverse
    nearest = np.argsort(np.abs(squares), kind="stable")[:count]
    chosen = nearest[np.argsort(squares[nearest], kind="stable")]
    squares = np.where(np.abs(squares) < ROUNDING * bound, 0.0, squares)
    return squares[chosen], vectors[:, chosen]
