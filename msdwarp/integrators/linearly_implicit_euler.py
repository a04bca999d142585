"""Linearly implicit Euler."""

import functools
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import warp as wp

from .. import checks
from ..engine import Dynamics, Rates, Solve, Stage, State, add_linearised, write_diagonal_blocks
from ..kernels.integrators.conjugate_gradients import conjugate_gradients
from ..kernels.integrators.implicit import block_inverses, implicit_finish, impulse, mass_product
from .base import Integrator, kick_drift_limit


class Work(NamedTuple):
    """Workspace of a solve: vectors and matrices, one per particle."""

    r: wp.array
    """Right-hand side, later the residual; at driven particles the impulse of their forces [kg m/s]."""
    dv: wp.array
    """The solution: changes of velocity [m/s]."""
    p: wp.array
    """Search direction."""
    q: wp.array
    """Product of the linear system's matrix with `p`."""
    z: wp.array
    """Preconditioned residual; before the solve, velocity changes of driven particles [m/s]."""
    springs: wp.array
    """Diagonal blocks of K, float64 [N/m]."""
    dampers: wp.array
    """Diagonal blocks of B, float64 [N s/m]."""
    inverses: wp.array
    """Inverses of the diagonal blocks of the linear system [1/kg]."""
    numbers: wp.array
    """Scalars of the conjugate gradient method, float64."""


@dataclass(frozen=True)
class LinearlyImplicitEuler(Integrator):
    """(M + hB + h²K) Δv = h (f − hKv), v += Δv, then x += h v, with K and B linearised at the current positions.

    Order 1, and strongly damping. Springs and dampers are stable at any step if the equations are solved
    accurately; effects such as loads are explicit. The Δv of driven particles is given by their motion. Use this
    method if a few springs are much stiffer, or particles much lighter, than all others. The equations are solved
    by matrix-free conjugate gradients, preconditioned by the inverses of diagonal blocks. Contact is handled after
    the solve: a stiff spring that hits a floor is strained by up to v h in a substep, so in long steps it bounces
    hard. For nonlinear dampers B uses the steepest slope, so long steps weaken their force. Reference: Baraff &
    Witkin, Large Steps in Cloth Simulation, SIGGRAPH (1998).

    Parameters
    ----------
    iterations
        Number of conjugate gradient iterations in a substep.

    Raises
    ------
    ValueError
        If `iterations` is not a whole number of at least 1.
    """

    iterations: int = 20

    order: ClassVar[int] = 1
    long_steps: ClassVar[bool] = True
    solves: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the argument."""
        checks.count("iterations", self.iterations, 1)

    @property
    def evaluations(self) -> int:
        """Force evaluations per substep; a product with the linearised system counts as one."""
        return self.iterations + 3

    @property
    def stage_times(self) -> tuple[float, ...]:
        """Times of force evaluations: only the start, since the second launch evaluates none."""
        return (0.0, 0.0)

    def workspace(self, state: State) -> Work:
        """Return the arrays for a solve; they must not be freed while a graph uses them."""
        x, numbers = state.x, wp.zeros(3, dtype=wp.float64, device=state.x.device)
        vector: Any = x.dtype
        dim, scalar = vector._length_, vector._wp_scalar_type_
        solving = *conjugate_gradients(dim, scalar), block_inverses(dim, scalar), mass_product(dim, scalar)
        state.model.kernels.note(*solving)
        kinds: list[Any] = [wp.types.matrix((dim, dim), kind) for kind in (wp.float64, wp.float64, scalar)]
        springs, dampers, inverses = (wp.zeros(len(x), dtype=kind, device=x.device) for kind in kinds)
        r, dv, p, q, z = state.model.vectors_together(5)
        return Work(r, dv, p, q, z, springs, dampers, inverses, numbers)

    def substep(self, state: State, work: Work, h: float) -> list[Stage | Solve]:
        """Return the stages of a substep of h seconds: impulse of forces, solve, advance of particles."""
        start, motion = state.state_in, state.motion()
        forces = {"compensation": start.compensation, "x": start.x, "v": start.v, "out": work.r, "given": work.z}
        return [
            Stage(impulse, {"h": h, **forces}),
            Solve(functools.partial(self._solve, x=start.x, v=start.v, work=work, h=h)),
            Stage(implicit_finish, {"h": h, "dv": work.dv, "impulse": work.r, **motion}),
        ]

    def _solve(self, dynamics: Dynamics, x: wp.array, v: wp.array, work: Work, h: float) -> None:
        """Solve for Δv; afterwards `work.r` has the impulses that the forces exert on driven particles."""
        drives = dynamics.drives
        add = functools.partial(add_linearised, dynamics.model, x, everyone=drives)
        add(v, work.r, spring=1.0, damper=0.0, scale=-h * h)
        if drives:  # move their known Δv to the right-hand side
            add(work.z, work.r, spring=h * h, damper=h, scale=-1.0)
        self._conjugate_gradients(dynamics, x, work, h)
        if drives:  # add forces on driven particles caused by other particles' Δv
            add(work.dv, work.r, spring=h * h, damper=h, scale=-1.0)

    def _conjugate_gradients(self, dynamics: Dynamics, x: wp.array, work: Work, h: float) -> None:
        """Solve (M + hB + h²K) dv = r; afterwards r is the residual.

        The solver in warp.optim.linear took 2.4 ms per iteration on the CPU for 27 particles.
        """
        model, (r, dv, p, q, z, springs, dampers, inverses, numbers) = dynamics.model, work
        size, kinds = model.particle_count, (model.dim, model.scalar)
        launch = functools.partial(wp.launch, device=model.device)
        numbers.zero_()
        write_diagonal_blocks(model, x, springs, dampers)
        launch(block_inverses(*kinds), size, [model.inverse_mass, springs, dampers, h], [inverses])
        begin, multiply, advance, turn, shift = conjugate_gradients(*kinds)
        threads = min(size, 8192) if model.device.is_cuda else 1
        launch(begin, threads, [inverses, r, dv, p, threads, numbers])
        for _ in range(self.iterations):
            launch(mass_product(*kinds), size, [model.inverse_mass, p, q])
            add_linearised(model, x, p, q, spring=h * h, damper=h, scale=1.0)
            launch(multiply, threads, [p, q, threads, numbers])
            launch(advance, threads, [inverses, p, q, dv, r, z, threads, numbers])
            launch(turn, size, [z, p, numbers])
            launch(shift, 1, [numbers])

    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s]; only explicit effects limit it."""
        return kick_drift_limit(rates.effect_stiffness, rates.effect_damping)
