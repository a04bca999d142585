"""Model, what is constant during a frame, and State, what moves, as arrays on a device."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from . import checks
from .colliders import Collider
from .kernels.basis import vector
from .kernels.compensation import compensation
from .kernels.records import record_length
from .routes import choose_route, scatter_order
from .surroundings import Surroundings
from .system import System

PRECISIONS = {
    "float32": (wp.float32, np.float32),
    "float32-compensated": (wp.float32, np.float32),
    "float64": (wp.float64, np.float64),
}
CONTACT_RULES = ("coulomb", "report")


def find_device(name: str | None) -> Any:
    """Return the Warp device called `name`; by default the first CUDA device, else the CPU.

    Raises
    ------
    ValueError
        If there is no such device here; the message lists those there are.
    """
    wp.init()
    if name is None:
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    try:
        return wp.get_device(name)
    except Exception as error:
        known = ", ".join(device.alias for device in wp.get_devices())
        raise ValueError(f"device {name!r} is not available; there is: {known}") from error


def scalar_array(values: NDArray[np.float64], scalar: Any, device: Any) -> wp.array:
    """Upload numbers; what is one constant everywhere takes one number of memory (a stride-0 view)."""
    if len(values) > 1 and values.strides == (0,):
        one = wp.full(1, scalar(values[0]), dtype=scalar, device=device)
        view = wp.array(
            ptr=one.ptr, dtype=scalar, shape=len(values), strides=(0,), device=device, capacity=one.capacity
        )
        view._ref = one  # a view does not own its memory
        return view
    return wp.array(values, dtype=scalar, device=device)


class Model:
    """A system and its surroundings on a device: everything that a substep reads and never writes.

    Parameters
    ----------
    system
        What is simulated.
    gravity
        Acceleration of free fall [m/s²]: its size, downwards along the last coordinate, or a vector of
        shape [d].
    colliders
        Obstacles, in the order in which a particle meets them.
    contact
        The contact rule, "coulomb" or "report"; see `msdwarp.kernels.contact`.
    device
        A Warp device's name; by default the first CUDA device, else the CPU.
    precision
        "float32", "float32-compensated" (sums of positions and velocities keep what rounding takes away) or
        "float64".
    route
        How forces are summed: "scatter", "gather" or "stencil" (see `msdwarp.kernels.forces`); "auto" takes the
        one that was fastest where it was measured (see `msdwarp.routes`).

    Raises
    ------
    ValueError
        If an argument is out of its range, or the system is no lattice that a stencil can hold.
    """

    def __init__(
        self,
        system: System,
        *,
        gravity: ArrayLike = 9.82,
        colliders: Sequence[Collider] = (),
        contact: str = "coulomb",
        device: str | None = None,
        precision: str = "float32",
        route: str = "auto",
    ) -> None:
        checks.one_of("precision", precision, PRECISIONS)
        checks.one_of("contact", contact, CONTACT_RULES)
        self.device = find_device(device)
        self.precision = precision
        self.scalar, self.dtype = PRECISIONS[precision]
        self.dim = system.dim
        self.vector = vector(self.dim, self.scalar)
        self.particle_count = system.particle_count
        self.connection_count = system.connection_count

        self.system = system
        self.route, self.lattice = choose_route(system, route, on_gpu=self.device.is_cuda)
        # A stencil reads around particles that have fewer neighbours, never past this many of them; in whole
        # lines of the GPU's caches (128 bytes).
        self.margin = -(-self.lattice.margin // 8) * 8 if self.lattice else 0

        self.compensated = precision == "float32-compensated"
        # What a scene lacks is not compiled.
        self.damper = system.damper.law if system.damping.any() else None
        self.yields = system.yields
        self.pinned = bool(system.pinned.any())

        self.gravity = self.vector(*_gravity_vector(gravity, self.dim))
        self.inverse_mass = self._upload(_uniform(1.0 / system.mass, system.mass), "1 / mass")
        self._order = scatter_order(system) if self.device.is_cuda and self.route == "scatter" else None
        self.connections = wp.array(self.ordered(system.connections), dtype=wp.vec2i, device=self.device)
        rest_length = system.rest_length
        if self.yields:  # each connection has its own, which the run changes
            rest_length = np.array(rest_length)
        self.rest_length = self._upload(self.ordered(rest_length), "rest_length")
        self.stiffness = self._upload(self.ordered(system.stiffness), "stiffness")
        self.damping = self._upload(self.ordered(system.damping), "damping")
        # What an explicit step must bear: the steepest slope of the dampers' law.
        slope = system.damper.steepest
        self.steepest_damping = self.damping
        if self.damper and slope != 1:
            steepest = _uniform(slope * system.damping, system.damping)
            self.steepest_damping = self._upload(self.ordered(steepest), "damping")
        self.surroundings = Surroundings(colliders, contact, dim=self.dim, scalar=self.scalar, device=self.device)

    def check_range(self, values: NDArray[np.float64], name: str) -> None:
        """Raise ValueError if a number is too large for this precision."""
        most = float(np.finfo(self.dtype).max)
        checks.within(name, values, (lambda v: np.abs(v) <= most, f"at most {most:.2g} in {self.precision}"))

    def ordered(self, values: NDArray) -> NDArray:
        """Return what connections have in the order that connections are in on the device."""
        return values if self._order is None or values.strides == (0,) else values[self._order]

    def in_system_order(self, values: NDArray) -> NDArray:
        """Return what connections have on the device in the order of the system's connections."""
        if self._order is None:
            return values
        result = np.empty_like(values)
        result[self._order] = values
        return result

    def per_connection(self, name: str) -> wp.array:
        """Upload an array that the system has for its connections, a number for each."""
        return wp.array(self.ordered(np.array(getattr(self.system, name))), dtype=self.scalar, device=self.device)

    def vectors(self) -> wp.array:
        """Return zeros, one vector a particle, in records as `msdwarp.kernels.records` has them.

        As many particles as `margin` says may be read before the first and after the last.
        """
        length, size = record_length(self.dim), wp.types.type_size_in_bytes(self.scalar)
        storage = wp.zeros((self.particle_count + 2 * self.margin) * length, dtype=self.scalar, device=self.device)
        view = wp.array(
            ptr=int(storage.ptr or 0) + self.margin * length * size,
            dtype=self.vector,
            shape=self.particle_count,
            strides=(length * size,),
            device=self.device,
            capacity=storage.capacity,
        )
        view._ref = storage
        return view

    def _upload(self, values: NDArray[np.float64], name: str) -> wp.array:
        self.check_range(values, name)
        return scalar_array(values, self.scalar, self.device)


class Instant(NamedTuple):
    """What moves, at one instant: arrays as `Model.vectors` makes them."""

    x: wp.array
    """Positions [m]."""
    v: wp.array
    """Velocities [m/s]; between a frame's substeps at the integrator's own instants."""
    carried: tuple[wp.array, ...]
    """What else the integrator hands from one substep to the next."""
    lost: Any
    """Struct of what sums have lost by rounding: `x`, `v`, and `x_out` for the next instant."""


class State:
    """What moves, on a device, twice: at the present instant (`here`), and where the next is written (`there`).

    Parameters
    ----------
    model
        The system it is the state of.
    carried
        Number of arrays that the integrator carries along (see `Integrator.carried`).
    """

    def __init__(self, model: Model, carried: int = 0) -> None:
        self.model, self._at_home = model, True
        Lost, _ = compensation(model.dim, model.scalar, model.compensated)
        lost = [
            model.vectors() if model.compensated else wp.zeros(0, model.vector, device=model.device) for _ in "xxv"
        ]
        instants = []
        for x, x_out in ((lost[0], lost[1]), (lost[1], lost[0])):
            struct = Lost()
            struct.x, struct.x_out, struct.v = x, x_out, lost[2]
            arrays = self.empty_vectors(2 + carried)
            instants.append(Instant(arrays[0], arrays[1], arrays[2:], struct))
        self.here, self.there = instants

    @classmethod
    def of(cls, system: System, model: Model, carried: int = 0) -> Self:
        """Upload the positions and velocities of a system."""
        model.check_range(system.position, "position")
        model.check_range(system.velocity, "velocity")
        state = cls(model, carried)
        for name, exact in (("x", system.position), ("v", system.velocity)):
            rounded = exact.astype(model.dtype)
            getattr(state.here, name).assign(rounded)
            if model.compensated:  # what rounding takes from the start is not lost either
                for lost in {getattr(instant.lost, name) for instant in (state.here, state.there)}:
                    lost.assign((rounded - exact).astype(model.dtype))
        return state

    @property
    def x(self) -> wp.array:
        """Positions [m]."""
        return self.here.x

    @property
    def v(self) -> wp.array:
        """Velocities [m/s]."""
        return self.here.v

    @property
    def lost(self) -> Any:
        """What sums have lost by rounding."""
        return self.here.lost

    def empty_vectors(self, count: int) -> tuple[wp.array, ...]:
        """Return `count` arrays of zeros, one vector a particle: an integrator's working memory."""
        return tuple(self.model.vectors() for _ in range(count))

    def flip(self) -> None:
        """Make what has been written `there` the present."""
        self.here, self.there, self._at_home = self.there, self.here, not self._at_home

    def settle(self) -> None:
        """Bring the present back to the arrays that held it at first, which is where a graph expects it."""
        if not self._at_home:
            self.flip()
            for to, source in zip(moving(self.here), moving(self.there), strict=True):
                copy_vectors(to, source)


def moving(instant: Instant) -> list[wp.array]:
    """Return the arrays of an instant that are not shared with the next one."""
    return [array for array in (instant.x, instant.v, *instant.carried, instant.lost.x) if array.size]


def copy_vectors(to: Any, source: Any) -> None:
    """Copy arrays that `Model.vectors` made, as one piece of memory."""
    wp.copy(to._ref, source._ref)


def _uniform(values: NDArray, like: NDArray) -> NDArray:
    """Keep a constant stored once: `values` as a stride-0 view where `like` is one."""
    return np.broadcast_to(values[0], values.shape) if like.strides == (0,) else values


def _gravity_vector(gravity: ArrayLike, dim: int) -> NDArray[np.float64]:
    given = checks.array("gravity", gravity)
    if not np.isfinite(given).all():
        raise ValueError(f"gravity is {gravity!r}; it must be finite")
    if given.ndim == 0:
        downwards = np.zeros(dim)
        downwards[-1] = -given
        return downwards
    if given.shape != (dim,):
        raise ValueError(f"gravity has shape {given.shape}; it must be a number or have shape ({dim},)")
    return given
