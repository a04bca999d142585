"""Model: a system and its surroundings on a device, everything that a substep reads and never writes."""

from collections.abc import Mapping, Sequence

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from ... import checks
from ...bodies import System, is_uniform, stored, uniform_like
from ...kernels.basis import vector
from ...kernels.effect import ForceTerm
from ...quiet import in_turn
from ...world import (
    BODY_CONTACT_FORCE,
    CONTACT_FORCE,
    Collider,
    Falling,
    Gravity,
    Load,
    Probe,
    bound,
    check_loads,
    checked_probes,
    driven_particles,
    with_potential,
)
from ..device.device import PRECISIONS, find_device, scalar_array
from ..device.vector_arrays import records_together
from ..loads.external_work import Work
from ..springs.fracture import Fracture
from ..stepping.assemble import Surroundings, effects_of
from .force_algorithm import choose_force_algorithm, scatter_order

COLLIDER_RULES = ("coulomb", "report")


class Model:
    """A system and its surroundings on a device: everything that a substep reads and never writes.

    Parameters
    ----------
    system
        What is simulated.
    gravity
        Acceleration of free fall [m/s²]: its size, downwards along the last coordinate, or a vector of
        shape [d]; or a function of time [s] that returns one of these, whose weight is a load.
    colliders
        Obstacles, in the order in which a particle meets them.
    collider_rule
        The contact rule, "coulomb" or "report"; see `msdwarp.kernels.colliders`.
    loads
        What else acts on the system, each a `Load`.
    probes
        What is measured where a frame ends, by name.
    device
        A Warp device's name; by default the first CUDA device, else the CPU.
    precision
        "float32", "float32-compensated" (sums of positions and velocities keep what rounding takes away) or
        "float64".
    force_algorithm
        How forces are summed: "scatter", "gather" or "stencil" (see `msdwarp.kernels.springs`); "auto" takes the
        one that was fastest where it was measured (see `msdwarp.engine.model.force_algorithm`).

    Raises
    ------
    ValueError
        If an argument is out of its range, or the system is no lattice that a stencil can hold.
    """

    in_worlds = False
    """Whether there are many worlds of it: it is an `EnsembleModel` then."""
    worlds = 1
    """How many worlds there are of it."""
    generation = 0
    """Rises when what launches take becomes another array, number or kernel: what was recorded before is void."""

    @in_turn
    def __init__(
        self,
        system: System,
        *,
        gravity: Gravity = 9.82,
        colliders: Sequence[Collider] = (),
        collider_rule: str = "coulomb",
        loads: Sequence[Load] = (),
        probes: Mapping[str, Probe] | None = None,
        device: str | None = None,
        precision: str = "float32",
        force_algorithm: str = "auto",
        contact_forces: bool = False,
    ) -> None:
        checks.one_of("precision", precision, PRECISIONS)
        checks.one_of("collider_rule", collider_rule, COLLIDER_RULES)
        self.device = find_device(device)
        self.precision = precision
        self.scalar, self.dtype = PRECISIONS[precision]
        self.dim = system.dim
        self.vector = vector(self.dim, self.scalar)
        self.particle_count = system.particle_count
        self.connection_count = system.connection_count

        self.system = system
        self.force_algorithm, self.lattice = choose_force_algorithm(
            system, force_algorithm, on_gpu=self.device.is_cuda
        )
        # A stencil reads around particles that have fewer neighbours, never past this many of them; in whole
        # lines of the GPU's caches (128 bytes).
        self.margin = -(-self.lattice.margin // 8) * 8 if self.lattice else 0

        self.compensated = precision == "float32-compensated"
        # What a scene lacks is not compiled.
        self.damper = system.damper.law if system.damping.any() else None
        check_loads(loads, system)
        loads = bound(loads, system)
        self.driven = driven_particles(loads, system)
        """Which particles drives move, shape [particle_count]."""
        # What is driven no force moves: as what is pinned, it has no end of mass.
        self.mass = np.where(self.driven, np.inf, system.mass) if self.driven.any() else system.mass
        self.pinned = bool(np.isinf(self.mass).any())

        self.fall(with_potential(gravity))
        self.falling = Falling(gravity, on=np.isfinite(self.mass)) if callable(gravity) else None
        """The weight of its particles, where gravity changes with time and so is a load."""
        self._check_masses()
        self.inverse_mass = self._upload(uniform_like(1.0 / self.mass, self.mass), "1 / mass")
        self.order = scatter_order(system) if self.device.is_cuda and self.force_algorithm == "scatter" else None
        """The system's number of each connection on the device; None where both have one order."""
        self.connections = wp.array(self.ordered(system.connections), dtype=wp.vec2i, device=self.device)
        rest_length = system.rest_length
        if self.lengths_change:  # each connection has its own
            rest_length = np.array(rest_length)
        self.rest_length = self._upload(self.ordered(rest_length), "rest_length")
        self.stiffness = self._upload_unbroken(system.stiffness, "stiffness")
        self.damping = self._upload_unbroken(system.damping, "damping")
        # What an explicit step must bear: the steepest slope of the dampers' law.
        slope = system.damper.steepest
        self.steepest_damping = self.damping
        if self.damper and slope != 1:
            steepest = uniform_like(slope * system.damping, system.damping)
            self.steepest_damping = self._upload_unbroken(steepest, "damping")
        self.probes = checked_probes(probes or {}, system, colliders, loads)
        around = Surroundings(tuple(colliders), collider_rule, loads, self.probes, contact_forces)
        self.feels_contact = around.asks_for(CONTACT_FORCE, BODY_CONTACT_FORCE)
        """Whether effects sum what contacts push particles with."""
        self.effects = effects_of(self, around)

    def fall(self, gravity: ArrayLike) -> None:
        """Take another gravity [m/s²], which who has read it must read again; ValueError if it is none."""
        towards = checks.gravity("gravity", gravity, self.dim)
        self.check_range(towards, "gravity")
        self.gravity = self.vector(*towards)
        self.generation += 1

    @property
    def stride(self) -> int:
        """How far one world's particles lie from the next one's, in particles."""
        return self.particle_count

    def row_of(self, name: str) -> NDArray[np.float64]:
        """Return what worlds have of a parameter of the system, shape [rows, ...]; a single one has one row."""
        return np.asarray(self.mass if name == "mass" else getattr(self.system, name))[None]

    @property
    def work(self) -> Work | None:
        """The work of its loads, where it has such."""
        return next((effect for effect in self.effects if isinstance(effect, Work)), None)

    def go_on_from(self, model: "Model", x: wp.array, v: wp.array) -> None:
        """Take over what a run has summed with a model of the same loads, whose particles were at x, at v."""
        if self.work is not None and model.work is not None:
            self.work.before += model.work.total(x, v)
        for effect in self.effects:
            same = next((one for one in model.effects if type(one) is type(effect)), None)
            if same is not None:
                effect.go_on_from(same)

    @property
    def tearing(self) -> Fracture | None:
        """What breaks connections; None where none can break or is broken."""
        return next((effect for effect in self.effects if isinstance(effect, Fracture)), None)

    @property
    def begins_substeps(self) -> bool:
        """Whether anything happens to connections as a substep begins: an effect acts on them, or they break."""
        pieces = [one.piece for one in self.effects if isinstance(one.piece, ForceTerm)]
        return self.tearing is not None or any(piece.begin is not None for piece in pieces)

    @property
    def lengths_change(self) -> bool:
        """Whether a run changes rest lengths, so that the algorithms must read them where they are."""
        return self.system.yields

    def _check_masses(self) -> None:
        """Raise ValueError for a mass whose inverse this precision has not: as 0 it would pin the particle."""
        mass, numbers = self.system.mass, np.finfo(self.dtype)
        # Inverses are kept to numbers of full accuracy: what is smaller some devices take for 0.
        least, most = 1.0 / float(numbers.max), 1.0 / float(numbers.tiny)
        one = stored(mass)
        fits = np.isinf(one) | ((one >= least) & (one <= most))
        if not fits.all():
            allowed = f"from {least:.2g} to {most:.2g} in {self.precision}, or inf, which pins the particle"
            checks.every("mass", mass, np.broadcast_to(fits, mass.shape), allowed)

    def check_range(self, values: NDArray[np.float64], name: str) -> None:
        """Raise ValueError if a number is too large for this precision."""
        most = float(np.finfo(self.dtype).max)
        checks.within(name, values, (lambda v: np.abs(v) <= most, f"at most {most:.2g} in {self.precision}"))

    def ordered(self, values: NDArray) -> NDArray:
        """Return what connections have in the order that connections are in on the device."""
        return values if self.order is None or is_uniform(values) else values[self.order]

    def in_system_order(self, values: NDArray) -> NDArray:
        """Return what connections have on the device in the order of the system's connections."""
        if self.order is None:
            return values
        result = np.empty_like(values)
        result[self.order] = values
        return result

    def per_connection(self, name: str) -> wp.array:
        """Upload an array that the system has for its connections, a number for each."""
        return wp.array(self.ordered(np.array(getattr(self.system, name))), dtype=self.scalar, device=self.device)

    def per_particle(self, values: NDArray[np.float64], name: str) -> wp.array:
        """Upload a number for each particle, checked against the precision; what is uniform is stored once."""
        return self._upload(values, name)

    def vectors(self) -> wp.array:
        """Return zeros, one vector a particle, in records as `msdwarp.kernels.records` has them.

        As many particles as `margin` says may be read before the first and after the last.
        """
        return self.vectors_together(1)[0]

    def vectors_together(self, count: int) -> tuple[wp.array, ...]:
        """Return `count` such arrays, in one piece of memory, `_ref`, where Warp has arrays that large."""
        return records_together(count, self.vectors_each, self.dim, self.scalar, self.device, self.margin)

    @property
    def vectors_each(self) -> int:
        """Vectors in an array of them: one a particle."""
        return self.particle_count

    def _upload_unbroken(self, values: NDArray[np.float64], name: str) -> wp.array:
        """Upload what connections have, 0 for broken ones; where any can break, a number for each."""
        if self.system.tears:
            values = np.where(self.system.broken, 0.0, values)
        return self._upload(self.ordered(values), name)

    def _upload(self, values: NDArray[np.float64], name: str) -> wp.array:
        self.check_range(values, name)
        return scalar_array(values, self.scalar, self.device)
